"""Motion and torque of a recording as a regression can use them.

All channels pass the same zero-phase low-pass, speeds and accelerations are central differences of
the filtered position (Gautier, 1997; Janot et al., 2014): what the filter does to one side of the
equation it does to the other. The drive's own speed channel is not used, for it lags.

At rest the torque is undetermined within the friction, a residual hundreds of times that of motion,
and every filter carries it into the motion beside it. Rows within the reach of the low-pass are
therefore not used, and the filter before decimation gets zeros for rest, on both sides of the
equation.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..messages.samples import (
    ANGLE,
    EXTERNAL_FORCE,
    SETPOINT,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
    Booleans,
    Floats,
    SampleFrame,
)
from ..recordings.conditioning import (
    CUTOFF_SHARE,
    anti_alias,
    central_difference,
    low_pass,
    mean_of_held,
    uniform_runs,
    white_noise_rms,
    with_angle,
)

OPTIONAL = (TORQUE, ANGLE, TABLE_POSITION, SETPOINT, TEMPERATURE, EXTERNAL_FORCE)
ORDER = 4
"""Of the Butterworth filter in each direction."""
DECIMATION = 10
"""Samples of which one row of a regression is taken."""
_REACH_PERIODS = 2.0


@dataclass(frozen=True, slots=True)
class PreparationSettings:
    """Settings for the filtering of recordings."""

    ratio_m_per_rad: float  # R_t of (4.3.5); a recording without a rotary encoder gets x / R_t
    cutoff_hz: float = 100.0  # of the low-pass, run forwards and backwards
    edge_s: float = 0.02  # cut from both ends of a run, where the filters have no past or no future
    standstill_rad_s: float = 0.1  # motor speed below which friction is undetermined
    # by how much the middle of a torque's action lies after its time stamp; half a period for a
    # command that is held until the next. 0 takes it as a continuous signal
    torque_delay_s: float = 0.0

    @classmethod
    def sampled(
        cls, ratio_m_per_rad: float, frames: Sequence[SampleFrame], cutoff_hz: float
    ) -> "PreparationSettings":
        """Settings for recordings of a torque that is held from sample to sample.

        The cutoff is less where the samples are too far apart for it.
        Raises ValueError: a clock that stands.
        """
        steps = np.concatenate([np.diff(frame.time_s) for frame in frames])
        forward = steps[steps > 0.0]
        if forward.size == 0:
            raise ValueError("time_s never increases; a recording needs a clock")
        period_s = float(np.median(forward))
        return cls(
            ratio_m_per_rad,
            cutoff_hz=min(cutoff_hz, CUTOFF_SHARE / period_s),
            torque_delay_s=0.5 * period_s,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PreparedRun:
    """One unbroken run: low-passed channels and the motion that follows from them."""

    # start_s, period_s: of the samples, before decimation, s
    start_s: float
    period_s: float
    channels: Mapping[str, Floats]  # low-passed, shape (n,); the angle is always there
    # speed_rad_s, acceleration_rad_s2: of the motor, (n,)
    speed_rad_s: Floats
    acceleration_rad_s2: Floats
    moving: Booleans  # samples not at, nor within the reach of the low-pass of, a standstill, (n,)
    noise_rms: Mapping[str, float]  # white noise of the raw position channels, by channel
    settings: PreparationSettings  # what it was prepared with

    def __len__(self) -> int:
        return len(self.speed_rad_s)

    @property
    def time_s(self) -> Floats:
        """Shape (n,)."""
        return self.start_s + self.period_s * np.arange(len(self), dtype=np.float64)

    def rate(self, name: str, times: int = 1) -> Floats:
        """Central difference of a channel, `times` times over, per s^times, (n,)."""
        values = self.channels[name]
        for _ in range(times):
            values = central_difference(values, self.period_s)
        return values

    def moving_rows(self, values: Floats) -> Floats:
        """Decimated rows of motion; rest beside it counts as zero, (n,) or (n, p) -> fewer rows."""
        if values.ndim > 1:
            return np.column_stack([self.moving_rows(column) for column in values.T])
        rows = np.where(self.moving, values, 0.0)
        return anti_alias(rows, DECIMATION)[::DECIMATION][self.moving[::DECIMATION]]


def prepare(
    frames: Iterable[SampleFrame] | SampleFrame,
    settings: PreparationSettings,
    required: tuple[str, ...] = (TORQUE,),
    beside: Collection[str] = OPTIONAL,
) -> Iterator[PreparedRun]:
    """Clean, filter and differentiate one recording, run by run, in bounded memory.

    Every row has a position and the required channels; a run, those of `beside` that it can have.
    Raises ValueError: a channel is missing, or the low-pass lies above half of the sampling rate.
    """
    angled = with_angle(frames, settings.ratio_m_per_rad)
    for run in uniform_runs(angled, (ANGLE, *required), optional=OPTIONAL):
        edge, period_s = math.ceil(settings.edge_s / run.period_s), run.period_s
        if len(run) < 2 * edge + 10 * DECIMATION:
            continue
        raw = {n: v for n, v in run.channels.items() if n in (ANGLE, *required, *beside)}
        if settings.torque_delay_s != 0.0 and TORQUE in raw:
            raw[TORQUE] = mean_of_held(raw[TORQUE], settings.torque_delay_s / period_s)
        smooth = {
            name: low_pass(values, settings.cutoff_hz, ORDER, period_s)
            for name, values in raw.items()
        }
        speed = central_difference(smooth[ANGLE], period_s)
        acceleration = central_difference(speed, period_s)
        # within two periods of the cutoff around a rest, more than e^-5 of it is left
        at_rest = np.abs(speed) < settings.standstill_rad_s
        reach = 2 * math.ceil(_REACH_PERIODS / (settings.cutoff_hz * period_s)) + 1
        moving: Booleans = ~ndimage.maximum_filter1d(at_rest, reach, mode="nearest")
        inside = slice(edge, len(run) - edge)
        positions = [name for name in (ANGLE, TABLE_POSITION) if name in raw]
        yield PreparedRun(
            start_s=run.start_s + edge * period_s,
            period_s=period_s,
            channels={name: values[inside] for name, values in smooth.items()},
            speed_rad_s=speed[inside],
            acceleration_rad_s2=acceleration[inside],
            moving=moving[inside],
            noise_rms={name: white_noise_rms(raw[name]) for name in positions},
            settings=settings,
        )


def derivative_noise_rms(run: PreparedRun, name: str, times: int) -> float:
    """Noise that a channel's white noise leaves in its decimated `times`-fold rate.

    It is the noise's standard deviation times the norm of the impulse response of the whole chain.
    """
    settings, period_s = run.settings, run.period_s
    reach = max(round(8.0 / (settings.cutoff_hz * period_s)), 20 * DECIMATION)
    response = np.zeros(2 * reach + 1)
    response[reach] = 1.0
    response = low_pass(response, settings.cutoff_hz, ORDER, period_s)
    for _ in range(times):
        response = central_difference(response, period_s)
    response = anti_alias(response, DECIMATION)
    return run.noise_rms.get(name, 0.0) * float(np.linalg.norm(response))
