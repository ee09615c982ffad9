"""`[commissioned]` of a machine file: parameters identified on a healthy, cold axis."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


def _pairs(raw: Any) -> Any:
    return tuple(tuple(pair) for pair in raw) if isinstance(raw, list) else raw


def _is_none(value: object) -> bool:
    """Left out where it is not known, so that kept states of older files stay theirs."""
    return value is None


class TransmissionConfig(_Table):
    """`[commissioned.transmission]`: the stretch between both encoders; absent with one encoder.

    Attributes:
        stretch_per_acceleration_s2: M C, stretch per acceleration of the table at `reference_m`.
        stretch_slope_s2_per_m: how that rises with the table's position.
        stretch_sigma_s2: its standard deviation.
        nut_share: of the compliance at `reference_m`, with its standard deviation.
        reversal_force_n: friction that stretches the axis at a reversal: guides, and of the
            screw's drag what acts behind its spring.
        lead_map_m: difference of the encoders at even nodes from 0 to the stroke.
        wind_up_map_m: half of what the reversal differs there from that of `reversal_force_n`.
        map_sigma_m: standard deviation of both maps: large where the axis has not been.
        noise_density_m2_s: variance of a mean over one second of fast motion.
        noise_slow_rad_s: motion as slow as this has twice that variance.
    """

    reference_m: float
    stretch_per_acceleration_s2: float = Field(gt=0.0)
    stretch_slope_s2_per_m: float = 0.0
    stretch_sigma_s2: float = Field(0.0, ge=0.0)
    nut_share: float = Field(gt=0.0, le=1.0)
    nut_share_sigma: float = Field(ge=0.0)
    reversal_force_n: float = Field(ge=0.0)
    guide_viscous_n_s_per_m: float = 0.0
    clock_skew_s: float = 0.0
    lead_map_m: tuple[float, ...] = ()
    wind_up_map_m: tuple[float, ...] = ()
    map_sigma_m: tuple[float, ...] = ()
    noise_density_m2_s: float = Field(gt=0.0)
    noise_slow_rad_s: float = Field(0.0, ge=0.0)


class CommissionedConfig(_Table):
    """`[commissioned]`: friction of the whole axis and the noise around the model.

    Attributes:
        coulomb_nm: whole Coulomb friction of the axis at the motor shaft.
        stribeck_excess_nm: excess at slow motion, falling with exp(-|v| / stribeck_speed_rad_s).
        stroke_map: cosine and sine of the k-th harmonic of preload over its mean along the stroke.
        noise_density_nm2_s: variance of a mean over one second of fast motion.
        noise_slow_rad_s: motion as slow as this has twice that variance.
        edge_noise_rad2_s2: variance of the speed at the border of two phases, where it matters.
        motion_s: steady motion behind all this.
        slowest_rad_s, cruise_rad_s2: what counts as steady on an axis that moves slowly.
        sample_period_s: time between the samples behind it; None in files that do not say, which
            were made of samples as fast as a drive holds its torque.
        interval_s: length of a block of features; None: 0.1 s.
        assumed_fresh: somebody said that the screw was fresh; the recordings did not show it.
    """

    torque_offset_nm: float = 0.0
    viscous_asymmetry_nm_s_per_rad: float = 0.0
    stribeck_excess_nm: float = 0.0
    stribeck_speed_rad_s: float = Field(1.0, gt=0.0)
    stroke_map: Annotated[tuple[tuple[float, float], ...], BeforeValidator(_pairs)] = ()
    coulomb_nm: float = Field(gt=0.0)
    noise_density_nm2_s: float = Field(gt=0.0)
    noise_slow_rad_s: float = Field(0.0, ge=0.0)
    edge_noise_rad2_s2: float = Field(0.0, ge=0.0)
    motion_s: float = Field(gt=0.0)
    slowest_rad_s: float | None = Field(None, gt=0.0)
    cruise_rad_s2: float | None = Field(None, gt=0.0)
    transmission: TransmissionConfig | None = None
    sample_period_s: float | None = Field(None, gt=0.0, exclude_if=_is_none)
    interval_s: float | None = Field(None, ge=0.001, le=10.0, exclude_if=_is_none)
    assumed_fresh: bool | None = Field(None, exclude_if=_is_none)
