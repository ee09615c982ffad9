"""The machine file's content: what the baseline model of one axis contains."""

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ..messages.samples import CHANNELS, TIME, ColumnMap
from .commissioned import CommissionedConfig
from .screw.ball_screw import BallPassOrders, ball_pass_orders, transmission_ratio

DEFAULT_TOLERANCE = 0.01
"""Relative calibration tolerance of a number that states none (one standard deviation)."""
GRAVITY_M_S2 = 9.80665
INTERVAL_S = 0.1  # length of a block of features where no commissioning has stated another
MEASURED_SUM = 0.02
"""Relative standard deviation of the frictions of a commissioned axis, taken together."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Quantity(_Table):
    """A calibrated number: `value` in SI units and its relative `tolerance` (one sigma)."""

    value: float
    tolerance: float = Field(DEFAULT_TOLERANCE, ge=0.0, le=10.0)

    @property
    def sigma(self) -> float:
        """Standard deviation in the unit of `value`; never zero for a non-zero value."""
        return abs(self.value) * max(self.tolerance, 1e-4)


def _as_quantity(raw: Any) -> Any:
    """Read a plain number as a Quantity with the default tolerance."""
    if isinstance(raw, int | float) and not isinstance(raw, bool):
        return {"value": raw}
    return raw


AnyQuantity = Annotated[Quantity, BeforeValidator(_as_quantity)]


class AxisConfig(_Table):
    """`[axis]`: geometry and limits. Only the lead is needed; what is missing is said."""

    name: str = "X"
    number: int | None = Field(None, ge=1)  # on the controller, in recordings that hold several
    lead_m: float = Field(gt=0.0, le=1.0)
    stroke_m: float | None = Field(None, gt=0.0)
    screw_diameter_m: float | None = Field(None, gt=0.0)
    screw_length_m: float | None = Field(None, gt=0.0)
    dynamic_load_rating_n: float | None = Field(None, gt=0.0)
    bearing_arrangement: Literal["fixed-free", "fixed-fixed"] = "fixed-free"
    ball_diameter_m: float | None = Field(None, gt=0.0)
    ball_circle_m: float | None = Field(None, gt=0.0)  # through the centres of the balls
    contact_angle_deg: float = Field(45.0, ge=0.0, lt=90.0)
    balls_per_turn: float | None = Field(None, gt=0.0)  # of one track
    max_speed_rad_s: float | None = Field(None, gt=0.0)
    max_torque_nm: float | None = Field(None, gt=0.0)
    max_acceleration_m_s2: float | None = Field(None, gt=0.0)

    @model_validator(mode="after")
    def _check_balls(self) -> "AxisConfig":
        if self.ball_diameter_m and self.ball_circle_m:
            if self.ball_diameter_m >= self.ball_circle_m:
                raise ValueError("ball_diameter_m must be less than ball_circle_m")
        elif self.balls_per_turn and not (self.ball_diameter_m or self.ball_circle_m):
            raise ValueError("balls_per_turn needs ball_diameter_m and ball_circle_m")
        return self


class ModelConfig(_Table):
    """`[model]`: rigid inertia at the motor shaft, viscous friction, Coulomb drag.

    `preload_drag_nm` is the fresh screw's own drag where `preload_n` is given; without `preload_n`
    it is the whole Coulomb level of the axis. `guide_force_n` and `bearing_drag_nm` come on top.
    """

    inertia_kg_m2: AnyQuantity
    viscous_nm_s_per_rad: AnyQuantity = Quantity(value=0.0)
    preload_drag_nm: AnyQuantity | None = None
    preload_n: AnyQuantity | None = None
    guide_force_n: AnyQuantity = Quantity(value=0.0)
    bearing_drag_nm: AnyQuantity = Quantity(value=0.0)
    table_mass_kg: AnyQuantity | None = None
    nut_stiffness_n_per_m: AnyQuantity | None = None

    @model_validator(mode="after")
    def _check_signs(self) -> "ModelConfig":
        for name in ("inertia_kg_m2", "preload_n", "table_mass_kg", "nut_stiffness_n_per_m"):
            quantity = getattr(self, name)
            if quantity is not None and quantity.value <= 0:
                raise ValueError(f"{name} must be greater than 0, got {quantity.value:g}")
        friction = ("viscous_nm_s_per_rad", "preload_drag_nm", "guide_force_n", "bearing_drag_nm")
        for name in friction:
            quantity = getattr(self, name)
            if quantity is not None and quantity.value < 0:
                raise ValueError(f"{name} must not be negative, got {quantity.value:g}")
        return self


_AsColumn = BeforeValidator(lambda raw: {"column": raw} if isinstance(raw, str) else raw)


class EffectConfig(_Table):
    """One modelled effect with its parameters (numbers, or `{ value, tolerance }`)."""

    name: str
    parameters: dict[str, AnyQuantity] = {}


class ToleranceConfig(_Table):
    """`[tolerance]`: gaps between model and machine, root mean square, up to which nobody acts."""

    torque_nm: float | None = Field(None, gt=0.0)
    position_m: float | None = Field(None, gt=0.0)


class Machine(_Table):
    """One axis as the baseline model knows it (the machine file)."""

    axis: AxisConfig
    model: ModelConfig
    columns: dict[str, Annotated[ColumnMap, _AsColumn]] = {}
    effects: tuple[EffectConfig, ...] = ()
    tolerance: ToleranceConfig = ToleranceConfig()
    commissioned: CommissionedConfig | None = None

    @model_validator(mode="after")
    def _check_columns(self) -> "Machine":
        for name in self.columns:
            if name != TIME and name not in CHANNELS:
                known = ", ".join([TIME, *CHANNELS])
                raise ValueError(f"columns.{name}: no channel of that name; channels are {known}")
        return self

    @property
    def transmission_ratio_m_per_rad(self) -> float:
        """Table travel per radian of the screw, m/rad (4.3.5)."""
        return transmission_ratio(self.axis.lead_m)

    @property
    def interval_s(self) -> float:
        """Length of a block of features, s."""
        stated = None if self.commissioned is None else self.commissioned.interval_s
        return INTERVAL_S if stated is None else stated

    @property
    def ball_pass_orders(self) -> BallPassOrders | None:
        """Orders at which the balls pass; None where the file does not know the balls."""
        axis = self.axis
        if axis.ball_diameter_m is None or axis.ball_circle_m is None:
            return None
        diameter_m, circle_m = axis.ball_diameter_m, axis.ball_circle_m
        contact_rad = math.radians(axis.contact_angle_deg)
        return ball_pass_orders(diameter_m, circle_m, axis.lead_m, contact_rad, axis.balls_per_turn)

    @property
    def other_drag_nm(self) -> Quantity:
        """Coulomb torque that is not the screw's own: guides and bearings, N m at the motor.

        Of a commissioned axis the sum was measured: it is known better than the shares, which the
        table's mass parts.
        """
        ratio = self.transmission_ratio_m_per_rad
        guide, bearing = self.model.guide_force_n, self.model.bearing_drag_nm
        value = guide.value * ratio + bearing.value
        if value == 0.0:
            return Quantity(value=0.0)
        guide_sigma = guide.sigma * ratio
        if self.commissioned is not None:
            guide_sigma = min(guide_sigma, MEASURED_SUM * value)
        sigma = math.hypot(guide_sigma, bearing.sigma)
        return Quantity(value=value, tolerance=sigma / value)

    @property
    def fresh_drag_nm(self) -> float:
        """The fresh screw's own drag, N m; 0 where the file states one level for the whole axis."""
        drag = self.model.preload_drag_nm
        return drag.value if drag is not None and self.model.preload_n is not None else 0.0

    @property
    def drag_per_percent_nm(self) -> float | None:
        """Screw drag torque per point of preload, N m; None where the file cannot tell.

        Drag is proportional to preload (4.3.6), so the fresh screw's pair fixes the ratio.
        """
        drag, fresh = self.model.preload_drag_nm, self.fresh_preload_percent
        return drag.value / fresh if drag and drag.value and fresh else None

    @property
    def fresh_preload_percent(self) -> float | None:
        """The fresh screw's preload in percent of the dynamic load rating; None if unknown."""
        rating, preload = self.axis.dynamic_load_rating_n, self.model.preload_n
        return None if rating is None or preload is None else 100.0 * preload.value / rating

    def missing_for_percent(self) -> str | None:
        """Key that is missing for preload in percent, or None if all are there."""
        if self.axis.dynamic_load_rating_n is None:
            return "axis.dynamic_load_rating_n"
        if self.model.preload_n is None:
            return "model.preload_n"
        if self.drag_per_percent_nm is None:
            return "model.preload_drag_nm"
        return None
