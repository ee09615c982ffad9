"""The stub's blocks hold what the axis did at the instants they count, whatever its rate."""

from typing import Any

import numpy as np
import pytest

from drivers.base import DriverContext
from drivers.mqtt.link import MqttSourceConfig
from drivers.mqtt.stub import FIRST_COUNT, EdgeWriter
from drivers.stub import StubAxis
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import SampleFrame

ANGLE = "motor_angle_rad"


async def _nothing() -> Any:
    for frame in ():
        yield frame


def writer() -> EdgeWriter:
    context = DriverContext("X", load_machine(DEFAULT_MACHINE))
    config = MqttSourceConfig(url="mqtt://127.0.0.1", topic="t")
    return EdgeWriter(StubAxis("X", config, context, _nothing()))


def sent(time_s: np.ndarray, cuts: list[int]) -> np.ndarray:
    """Count and angle in the control's unit of all rows, where the angle is the time in s."""
    made = writer()
    blocks = []
    for part in np.split(time_s, cuts):
        blocks += made.blocks(SampleFrame(part, {ANGLE: part.copy()}))
    rows = np.vstack(blocks + made.rest())
    column = 1 + list(made._factors).index(ANGLE)
    rows[:, column] *= made._factors[ANGLE]
    return rows[:, [0, column]]


@pytest.mark.parametrize("rate_hz", [400.0, 500.0, 700.0, 1000.0, 2000.0, 8000.0])
@pytest.mark.parametrize("cuts", [[], [1, 2, 5, 301], [200]], ids=["whole", "uneven", "two"])
def test_a_row_holds_what_was_at_the_instant_it_counts(rate_hz: float, cuts: list[int]) -> None:
    time_s = np.arange(0, 4000) / rate_hz
    rows = sent(time_s, cuts)
    assert np.all(np.diff(rows[:, 0]) == 1.0)
    assert rows[0, 0] == FIRST_COUNT
    np.testing.assert_allclose(rows[:, 1], (rows[:, 0] - FIRST_COUNT) * 0.002, atol=1e-9)
    assert rows[-1, 1] > time_s[-1] - 0.002


def test_over_a_gap_nothing_is_invented() -> None:
    time_s = np.concatenate([np.arange(0, 100), np.arange(400, 500)]) / 1000.0
    counts = sent(time_s, [100])[:, 0] - FIRST_COUNT
    assert counts.tolist() == [*range(50), *range(200, 250)]
