"""A reason names a channel as missing only where it is: whatever was cut off or left out."""

from itertools import combinations

import numpy as np
import pytest

from edge_service.fingerprint.fingerprint import fingerprint_axis
from edge_service.messages.samples import (
    ANGLE,
    CHANNELS,
    SETPOINT,
    TABLE_POSITION,
    TORQUE,
    SampleFrame,
)
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits

from ..foreign_plant import DIAGNOSIS, nominal_machine_toml

RATE_HZ = 1000.0
OPTIONAL = (TORQUE, TABLE_POSITION, SETPOINT)
LEFT_OUT = [left for size in range(len(OPTIONAL)) for left in combinations(OPTIONAL, size)]
SPANS = ("rest", "one reversal", "one way", "whole")
TURN = 8
"""Number of a reversal between moves of more than 0.2 mm."""


@pytest.fixture(scope="module")
def machine() -> Machine:
    import tomllib

    return Machine.model_validate(tomllib.loads(nominal_machine_toml(DIAGNOSIS)))


@pytest.fixture(scope="module")
def recording(machine: Machine) -> SampleFrame:
    """Slow reversals of the simulated axis."""
    limits = motion_limits(machine)
    plan = MOTIONS["reversals"].plan(limits, np.random.default_rng(1))
    count = round(plan.duration_s * RATE_HZ)
    drive = FeedDrive(FeedDriveSettings.of_machine(machine, RATE_HZ), limits.low_m, 6.8, 1)
    setpoints = Setpoints(iter(plan.segments), limits.low_m, RATE_HZ).take(count)
    return drive.advance(setpoints, np.full(count, 6.8))


def rows_of(frame: SampleFrame, span: str) -> slice:
    """Rows of a part, cut where the setpoint turns back."""
    way = np.sign(np.round(np.diff(frame.channels[SETPOINT]), 9))
    moving = np.flatnonzero(way)
    turns = [int(moving[k]) for k in np.flatnonzero(np.diff(way[moving]))]
    return {
        "rest": slice(0, 500),
        "one reversal": slice(turns[TURN - 1] + 250, turns[TURN + 1]),
        "one way": slice(300, turns[0]),
        "whole": slice(None),
    }[span]


def part_of(frame: SampleFrame, span: str, left_out: tuple[str, ...]) -> SampleFrame:
    rows = rows_of(frame, span)
    kept = {name: each[rows] for name, each in frame.channels.items() if name not in left_out}
    return SampleFrame(frame.time_s[rows], kept)


@pytest.mark.slow
@pytest.mark.parametrize("left_out", LEFT_OUT, ids=" ".join)
@pytest.mark.parametrize("span", SPANS)
def test_what_is_there_is_not_said_to_be_missing(
    span: str, left_out: tuple[str, ...], machine: Machine, recording: SampleFrame
) -> None:
    part = part_of(recording, span, left_out)
    for section in fingerprint_axis(machine, {"a": part}).sections.values():
        for reason in (section.reason, *(each.note for each in section.figures.values())):
            for clause in reason.split("; "):
                named = {name for name in CHANNELS if name in clause}
                assert not named or named - part.channels.keys(), clause


def test_a_single_reversal_is_called_so(machine: Machine, recording: SampleFrame) -> None:
    part = part_of(recording, "one reversal", ())
    section = fingerprint_axis(machine, {"a": part}).sections["reversal_error"]
    assert ANGLE not in section.reason
    assert "one slow reversal" in section.reason
