"""Common clock for the recordings of a session, and a bound on how much of them is kept."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ...checks.same_axis import by_recording
from ...models.effects.baseline import Motion
from ...regression.run import Run

LONGEST_S = 600.0
"""Of a longer session every second minute is kept, or every fourth, and so on."""
PIECE_S = 60.0
PAUSE_S = 1.0
"""Between recordings whose own clocks do not tell how far apart they were made."""


def on_one_clock(runs: Iterable[Run]) -> list[Run]:
    """Runs in the order of one clock, whatever the order of the recordings.

    Recordings whose clocks overlap (each may begin at 0) follow one another, the coldest first:
    an axis warms up in a session.
    """
    recordings = list(by_recording(thinned(runs)).values())
    spans = sorted((_start_s(each), _end_s(each)) for each in recordings)
    if all(before[1] < after[0] for before, after in itertools.pairwise(spans)):
        return [run for each in sorted(recordings, key=_start_s) for run in each]
    placed: list[Run] = []
    clock_s = 0.0
    for number, each in enumerate(sorted(recordings, key=_coldness)):
        shift_s = clock_s - _start_s(each) if number else 0.0
        for run in each:
            motion = replace(run.motion, time_s=run.motion.time_s + shift_s)
            placed.append(replace(run, motion=motion))
        clock_s = _end_s(placed[-1:]) + PAUSE_S
    return placed


def thinned(runs: Iterable[Run]) -> list[Run]:
    """Runs of at most about `LONGEST_S` in all, evenly spread over what was recorded."""
    kept: list[tuple[int, Run]] = []
    stride, number, held_s = 1, 0, 0.0
    for run in runs:
        parts = [run] if stride == 1 else _pieces(run)
        for part in parts:
            if number % stride == 0:
                kept.append((number, part))
                held_s += part.duration_s
            number += 1
        while held_s > LONGEST_S:
            if stride == 1:
                cut = [piece for _, each in kept for piece in _pieces(each)]
                kept, number = list(enumerate(cut)), len(cut)
            stride *= 2
            kept = [(k, each) for k, each in kept if k % stride == 0]
            held_s = sum(each.duration_s for _, each in kept)
    return [run for _, run in kept]


def _start_s(runs: Sequence[Run]) -> float:
    return min(float(run.motion.time_s[0]) for run in runs)


def _end_s(runs: Sequence[Run]) -> float:
    return max(float(run.motion.time_s[-1]) for run in runs)


def _coldness(runs: Sequence[Run]) -> tuple[float, ...]:
    """Temperature, then whatever else distinguishes recordings without regard to their order."""
    first = runs[0]
    warmth = [float(run.temperature_c.mean()) for run in runs if run.temperature_c is not None]
    motion = first.motion
    return (
        min(warmth, default=0.0),
        float(motion.time_s[0]),
        float(sum(run.duration_s for run in runs)),
        float(motion.angle_rad[0]),
        float(np.square(motion.angle_rad).mean()),
    )


def _pieces(run: Run) -> Iterator[Run]:
    step = max(round(PIECE_S * len(run.motion) / max(run.duration_s, 1e-9)), 1)
    if len(run.motion) <= 1.5 * step:
        yield run
        return
    for start in range(0, len(run.motion) - step // 2, step):
        end = start + step if len(run.motion) - start - step >= step // 2 else len(run.motion)
        yield _cut(run, slice(start, end))


def _cut(run: Run, span: slice) -> Run:
    """Copy of a part: the rest can be forgotten."""
    given = [each.name for each in fields(Motion) if each.init]
    motion = Motion(**{name: getattr(run.motion, name)[span].copy() for name in given})
    series = {each.name: getattr(run, each.name) for each in fields(Run)}
    parts: dict[str, Any] = {
        name: x[span].copy() for name, x in series.items() if isinstance(x, np.ndarray)
    }
    return replace(run, motion=motion, **parts)
