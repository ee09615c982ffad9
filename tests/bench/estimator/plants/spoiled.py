"""Recordings that no estimator should trust: a status and a reason, never a confident number."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine

from ..axis import RATE_HZ, OwnAxis, downsampled
from ..scores import Recorded, follow, score
from .own import Part

STUCK_S = (20.0, 35.0)
JOG_M = 40e-6
_Edit = Callable[[SampleFrame], SampleFrame]


@dataclass(frozen=True, slots=True)
class Hostile:
    """One spoiled recording of a healthy axis."""

    name: str
    edit: _Edit | None = None  # of the frames of ordinary production
    effects: tuple[str, ...] = ()  # of the test alone
    # position over time instead, m; the torque stays below the drag
    table_m: Callable[[Floats], Floats] | None = None


def scaled(channel: str, share: float) -> _Edit:
    return lambda frame: _with(frame, channel, frame.channels[channel] * share)


def stuck(channel: str) -> _Edit:
    """A channel that repeats one value from the first of `STUCK_S` to the second."""

    def edit(frame: SampleFrame) -> SampleFrame:
        held = (frame.time_s >= STUCK_S[0]) & (frame.time_s < STUCK_S[1])
        return _with(frame, channel, np.where(held, 1.0, frame.channels[channel]))

    return edit


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


def _with(frame: SampleFrame, channel: str, column: Floats) -> SampleFrame:
    return replace(frame, channels={**frame.channels, channel: column})


def _resting(time_s: Floats) -> Floats:
    return np.full_like(time_s, 0.4)


def _jogging(time_s: Floats) -> Floats:
    """To and fro by some tens of micrometres, smoothly, every two seconds."""
    turn = np.clip((time_s % 2.0) / 0.3, 0.0, 1.0)
    eased = turn**2 * (3.0 - 2.0 * turn)
    odd = np.floor(time_s / 2.0) % 2.0
    return np.asarray(0.4 + JOG_M * np.where(odd > 0.0, 1.0 - eased, eased))


CASES = (
    Hostile("no motion", table_m=_resting),
    Hostile("jogs of 40 um", table_m=_jogging),
    Hostile("saturated drive", effects=("saturation:limit_nm=0.9",)),
    Hostile("5 % of all values missing", edit=holed(0.05)),
    Hostile("torque missing", edit=scaled(TORQUE, np.nan)),
    Hostile("rotary encoder stuck", edit=stuck(ANGLE)),
    Hostile("linear encoder stuck", edit=stuck(TABLE_POSITION)),
    Hostile("torque stuck", edit=stuck(TORQUE)),
    Hostile("torque sign swapped", edit=scaled(TORQUE, -1.0)),
    Hostile("angle sign swapped", edit=scaled(ANGLE, -1.0)),
    Hostile("lead wrong by 2", edit=scaled(ANGLE, 2.0)),
    Hostile("lead wrong by 1 %", edit=scaled(ANGLE, 1.01)),
    Hostile("torque constant +30 %", edit=scaled(TORQUE, 1.3)),
    Hostile("torque constant -30 %", edit=scaled(TORQUE, 0.7)),
)


def hostile(quick: bool) -> Iterator[Part]:
    """Each spoiled recording on an axis that was commissioned well."""
    axis = OwnAxis(1)
    machine = axis.commissioned()
    duration_s = 36.0 if quick else 60.0
    for case in CASES:
        recording = spoiled(case, axis, machine, duration_s)
        yield Part(case.name, score(follow(MixturePreloadEstimator(machine), recording)))


def spoiled(case: Hostile, axis: OwnAxis, machine: Machine, duration_s: float) -> Recorded:
    count = round(duration_s * RATE_HZ)
    time_s = np.arange(count) / RATE_HZ
    percent = np.full(count, axis.fresh_percent)
    if case.table_m is not None:
        frames = iter([_still(machine, time_s, case.table_m(time_s))])
    else:
        frames = axis.frames("production", percent, 81, case.effects)
    edit = case.edit
    edited = frames if edit is None else (edit(frame) for frame in frames)
    return Recorded(downsampled(edited, machine), time_s, percent)


def _still(machine: Machine, time_s: Floats, table_m: Floats) -> SampleFrame:
    """Next to no motion, under a torque within the drag."""
    random = np.random.default_rng(91)
    noise = random.standard_normal((3, len(time_s)))
    torque = 0.1 * np.sin(2.0 * np.pi * 0.5 * time_s) + 0.02 * noise[0]
    angle = table_m / machine.transmission_ratio_m_per_rad + 5e-6 * noise[1]
    channels = {TORQUE: torque, ANGLE: angle, TABLE_POSITION: table_m + 5e-8 * noise[2]}
    return SampleFrame(time_s, channels)
