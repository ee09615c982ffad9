"""Samples that no drive can make are left out and named; what an axis does is not touched."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edge_service.checks.live.channel_limits import channel_limits
from edge_service.checks.live.excursions import longest_rows, mend
from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.messages.row_faults import THETA, U, X
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats

from .test_channel_check import EVERYDAY, SOUND, Axis, frame_of, moves, recording

AXIS = Axis()
COLUMNS = {TORQUE: U, ANGLE: THETA, TABLE_POSITION: X}
OUTLIERS = dict(
    zip(COLUMNS, (Fault.TORQUE_OUTLIERS, Fault.ANGLE_OUTLIERS, Fault.TABLE_OUTLIERS), strict=True)
)
HELD = dict(zip(COLUMNS, (Fault.TORQUE_HELD, Fault.ANGLE_HELD, Fault.TABLE_HELD), strict=True))
FAR = {TORQUE: 0.2, ANGLE: 1e-3, TABLE_POSITION: 1e-6}
"""From here on a value counts as wrong; nearer ones are within the noise of torque and position."""
MENDED = {TORQUE: 0.1, ANGLE: 1e-4, TABLE_POSITION: 5e-7}


def rows_of(columns: dict[str, Floats]) -> Floats:
    rows = np.full((len(columns["time_s"]), 8), np.nan)
    rows[:, 0] = columns["time_s"]
    for name, column in COLUMNS.items():
        rows[:, column] = columns[name]
    return rows


def constant(value: float) -> Callable[[Floats, Floats], Floats]:
    return lambda values, bad: np.where(bad, value, values)


KINDS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "zeros": constant(0.0),
    "sentinels": constant(-999.0),
    "values of 20 ms before": lambda values, bad: np.where(bad, np.roll(values, 20), values),
    "zeros in pairs": lambda values, bad: np.where(bad | np.roll(bad, 1), 0.0, values),
}


@pytest.mark.parametrize("channel", COLUMNS)
@pytest.mark.parametrize("kind", KINDS)
def test_samples_that_no_drive_can_make_are_replaced(channel: str, kind: str) -> None:
    columns = recording(Axis(chatter_n=200.0), moves(AXIS, [0.02, 0.3, 0.1]))
    truth = columns[channel]
    bad = np.random.default_rng(4).random(len(truth)) < 0.01
    rows = rows_of({**columns, channel: KINDS[kind](truth, bad)})
    wrong = np.abs(rows[:, COLUMNS[channel]] - truth) > FAR[channel]
    wrong[-10:] = False
    found = mend(rows, 0, len(rows), longest_rows(1e-3)) != 0
    assert found[wrong].mean() > 0.8
    assert np.count_nonzero(found[~bad & ~np.roll(bad, 1)]) < 1e-3 * len(rows)
    error = np.abs(rows[:, COLUMNS[channel]] - truth)[wrong & found]
    assert np.quantile(error, 0.9) < MENDED[channel]


@pytest.mark.parametrize("name", SOUND)
def test_what_a_sound_axis_does_is_not_replaced(name: str) -> None:
    axis = SOUND[name]
    rows = rows_of(recording(axis, moves(axis, EVERYDAY)))
    found = mend(rows, 0, len(rows), longest_rows(1.0 / axis.rate_hz))
    assert np.count_nonzero(found) < 1e-3 * len(rows)


def blocks_of(
    columns: dict[str, Floats], hold_s: tuple[float, ...] | None, *cuts: int, coarsest=(np.inf,) * 3
) -> list[FeatureBlock]:
    limits = replace(channel_limits(AXIS.machine), hold_s=hold_s, coarsest=coarsest)
    downsampler = Downsampler(DownsampleSettings(channels=limits), AXIS.ratio)
    frame = frame_of(columns)
    parts = zip((0, *cuts), (*cuts, len(frame)), strict=True)
    return [b for begin, end in parts for b in downsampler.push(frame.part(slice(begin, end)))]


@pytest.mark.parametrize(("channel", "fault"), OUTLIERS.items())
def test_what_was_left_out_is_named_however_the_samples_come(channel: str, fault: Fault) -> None:
    columns = recording(AXIS, moves(AXIS, [0.1, 0.3]))
    columns[channel][[540, 1350, 2001]] += 3.0
    blocks = blocks_of(columns, None)
    assert [round(b.time_s, 1) for b in blocks if fault in b.fault] == [0.6, 1.4, 2.1]
    assert repr(blocks) == repr(blocks_of(columns, None, 539, 543, 1300, 1351, 2000, 2004))


@pytest.mark.parametrize("rows", [2, 3, 5])
@pytest.mark.parametrize(("channel", "fault"), HELD.items())
def test_a_channel_that_is_held_for_longer_than_before_is_named(channel, fault, rows):
    columns = recording(AXIS, moves(AXIS, [0.02, 0.3]))
    as_before = blocks_of(columns, (0.0, 0.0, 0.0))
    assert not any(block.fault & fault for block in as_before)
    columns[channel] = np.repeat(columns[channel][::rows], rows)[: len(columns[channel])]
    moving = [b for b in blocks_of(columns, (0.0, 0.0, 0.0)) if b.moving_fraction == 1.0]
    assert np.mean([fault in block.fault for block in moving[3:]]) > 0.95
    known_s = (1e-3 * (rows - 1),) * 3
    assert not any(block.fault & fault for block in blocks_of(columns, known_s))


@pytest.mark.parametrize("channel", [ANGLE, TABLE_POSITION])
def test_a_position_that_is_coarser_than_before_is_named(channel: str) -> None:
    columns = recording(AXIS, moves(AXIS, [0.02, 0.3, 0.1]))
    most = dict(zip(COLUMNS, (np.inf, 5e-5, 2e-7), strict=True))  # ten times the encoders' noise
    for step, low, high in ((0.5 * most[channel], 0.0, 0.0), (2.0 * most[channel], 0.9, 1.0)):
        coarse = {**columns, channel: step * np.round(columns[channel] / step)}
        blocks = blocks_of(coarse, (0.0, 0.0, 0.0), coarsest=tuple(most.values()))
        moving = [block for block in blocks if block.moving_fraction == 1.0][3:]
        assert low <= np.mean([HELD[channel] in block.fault for block in moving]) <= high
