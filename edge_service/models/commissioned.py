"""`[commissioned]` of a machine file: parameters identified on a healthy, cold axis."""

import operator
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

_PAIRS = BeforeValidator(lambda raw: tuple(map(tuple, raw)) if isinstance(raw, list) else raw)


class _Table(BaseModel):
    """Table without what is not known, so that kept states of older files stay theirs."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class TransmissionConfig(_Table):
    """`[commissioned.transmission]`: the stretch between both encoders; absent with one encoder."""

    reference_m: float
    stretch_per_acceleration_s2: float = Field(gt=0.0)  # M C, of the table at `reference_m`
    stretch_slope_s2_per_m: float = 0.0  # its rise with the table's position
    stretch_bow_s2_per_m2: float = Field(0.0, exclude_if=operator.not_)  # and with its square
    stretch_sigma_s2: float = Field(0.0, ge=0.0)
    nut_share: float = Field(gt=0.0, le=1.0)  # of the compliance at `reference_m`
    nut_share_sigma: float = Field(ge=0.0)
    reversal_force_n: float = Field(ge=0.0)
    """Friction that stretches the axis at a reversal: guides, and of the screw's drag what acts
    behind its spring."""
    guide_viscous_n_s_per_m: float = 0.0
    clock_skew_s: float = 0.0
    lead_map_m: tuple[float, ...] = ()  # of the encoders, at even nodes from 0 to the stroke
    wind_up_map_m: tuple[float, ...] = ()  # half of what the reversal differs from its force
    map_sigma_m: tuple[float, ...] = ()  # of both maps: large where the axis has not been
    noise_density_m2_s: float = Field(gt=0.0)  # variance of a mean over one second of fast motion
    noise_slow_rad_s: float = Field(0.0, ge=0.0)  # motion as slow as this has twice that variance


class Notch(_Table):
    """Antiresonance by a test of shaking on a slow feed: the table swings against a held motor."""

    antiresonance_hz: float = Field(gt=0.0)
    antiresonance_sigma_hz: float = Field(ge=0.0)
    damping_ratio: float = Field(gt=0.0)
    inertia_ratio: float = Field(gt=0.0)  # M R^2 / J, of the table over motor and screw
    inertia_ratio_sigma: float = Field(ge=0.0)
    place_rad: float  # mean angle of the motor
    feed_rad_s: float = Field(gt=0.0)
    friction_nm: float | None = None  # half of what the torque differs between the directions


class NotchConfig(Notch):
    """`[commissioned.notch]`: the test of the healthy axis, mean of `repeats` of different days."""

    repeats: int = Field(ge=1)
    compliance_scatter: float = Field(gt=0.0)  # from day to day, standard deviation, a share
    nut_share: float = Field(gt=0.0, le=1.0)
    nut_share_sigma: float = Field(ge=0.0)


class CommissionedConfig(_Table):
    """`[commissioned]`: friction of the whole axis and the noise around the model."""

    torque_offset_nm: float = 0.0
    viscous_asymmetry_nm_s_per_rad: float = 0.0
    stribeck_excess_nm: float = 0.0  # falling with exp(-|v| / stribeck_speed_rad_s)
    stribeck_speed_rad_s: float = Field(1.0, gt=0.0)
    stroke_map: Annotated[tuple[tuple[float, float], ...], _PAIRS] = ()
    """Cosine and sine of the k-th harmonic of preload over its mean along the stroke."""
    coulomb_nm: float = Field(gt=0.0)  # whole Coulomb friction at the motor shaft
    noise_density_nm2_s: float = Field(gt=0.0)
    noise_slow_rad_s: float = Field(0.0, ge=0.0)
    edge_noise_rad2_s2: float = Field(0.0, ge=0.0)  # of the speed at the border of two phases
    motion_s: float = Field(gt=0.0)  # steady motion behind all this
    slowest_rad_s: float | None = Field(None, gt=0.0)  # what is steady on an axis that moves slowly
    cruise_rad_s2: float | None = Field(None, gt=0.0)
    transmission: TransmissionConfig | None = None
    sample_period_s: float | None = Field(None, gt=0.0, exclude_if=operator.not_)
    """Time between the samples behind it; None of those as fast as a drive holds its torque."""
    hold_s: tuple[float, float, float] | None = Field(None, exclude_if=operator.not_)
    """For how long torque, motor angle and table repeat a value; 0: new in each sample."""
    interval_s: float | None = Field(None, ge=0.001, le=10.0, exclude_if=operator.not_)
    """Length of a block of features; None: 0.1 s."""
    notch: NotchConfig | None = Field(None, exclude_if=operator.not_)
    assumed_fresh: bool | None = Field(None, exclude_if=operator.not_)  # said, not shown
    gap: dict[str, float] = Field({}, exclude_if=operator.not_)
    """Root mean square by which the recordings behind all this part from it, by channel."""
