"""Recordings that no estimator should trust: a status and a reason, never a confident number."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame

from ...bench.estimator.axis import RATE_HZ, downsampled
from .production import AXIS, FRESH, machine, run

STUCK_S = (20.0, 35.0)
_Edit = Callable[[SampleFrame], SampleFrame]


@dataclass(frozen=True, slots=True)
class Hostile:
    """One spoiled recording of a healthy axis."""

    edit: _Edit | None = None  # of the frames of ordinary production
    effects: tuple[str, ...] = ()  # of the test alone


def edited(name: str, edit: Callable[[Floats, Floats], Floats]) -> _Edit:
    """A channel of which `edit` makes another from time and values, (n,) each."""
    return lambda f: replace(f, channels=f.channels | {name: edit(f.time_s, f.channels[name])})


def scaled(channel: str, share: float) -> _Edit:
    return edited(channel, lambda _, column: column * share)


def stuck(channel: str) -> _Edit:
    """A channel that repeats one value from the first of `STUCK_S` to the second."""
    first_s, last_s = STUCK_S
    return edited(channel, lambda t, column: np.where((t >= first_s) & (t < last_s), 1.0, column))


def holed(share: float) -> _Edit:
    """A share of all values missing, one by one; always the same ones."""

    def edit(frame: SampleFrame) -> SampleFrame:
        random = np.random.default_rng(round(frame.time_s[0]))
        channels = {
            name: np.where(random.random(len(column)) < share, np.nan, column)
            for name, column in frame.channels.items()
        }
        return SampleFrame(frame.time_s, channels)

    return edit


CASES = {
    "saturated drive": Hostile(effects=("saturation:limit_nm=0.9",)),
    "5 % of all values missing": Hostile(holed(0.05)),
    "torque missing": Hostile(scaled(TORQUE, np.nan)),
    "rotary encoder stuck": Hostile(stuck(ANGLE)),
    "linear encoder stuck": Hostile(stuck(TABLE_POSITION)),
    "torque stuck": Hostile(stuck(TORQUE)),
    "torque sign swapped": Hostile(scaled(TORQUE, -1.0)),
    "angle sign swapped": Hostile(scaled(ANGLE, -1.0)),
    "lead wrong by 2": Hostile(scaled(ANGLE, 2.0)),
    "lead wrong by 1 %": Hostile(scaled(ANGLE, 1.01)),
    "torque constant +30 %": Hostile(scaled(TORQUE, 1.3)),
    "torque constant -30 %": Hostile(scaled(TORQUE, 0.7)),
    "angle 3 ms late": Hostile(edited(ANGLE, lambda _, x: np.r_[x[[0, 0, 0]], x[:-3]])),
    "table new every 2 ms": Hostile(edited(TABLE_POSITION, lambda _, x: x[::2].repeat(2))),
}


def answers_to(name: str, duration_s: float = 60.0) -> list[PreloadEstimate]:
    """Estimates of a well commissioned axis in one of `CASES`, (intervals,)."""
    case, percent = CASES[name], np.full(round(duration_s * RATE_HZ), FRESH)
    frames = AXIS.frames("production", percent, 81, case.effects)
    edited = frames if case.edit is None else map(case.edit, frames)
    return run(downsampled(edited, machine()))
