"""Mistakes that forbid an answer are told from faults of the machine, on axes of any speed."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edge_service.checks.examination import CHECKS, check_plausibility
from edge_service.checks.finding import Finding, Verdict
from edge_service.messages.samples import (
    ANGLE,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TABLE_SPEED,
    TEMPERATURE,
    TORQUE,
    Floats,
    SampleFrame,
)
from edge_service.models.machine import Machine

from ..estimate.commissioning.plain_axis import PlainAxis
from .test_plausibility import MACHINE, changed, recorded

BENCH = PlainAxis()
SLOW = replace(BENCH, lead_m=0.02, top_rad_s=1.5, acceleration_rad_s2=4.0, encoder_rad=1e-6)
HANGING = replace(BENCH, hanging_nm=6.0)
SPEEDS = (MOTOR_SPEED, TABLE_SPEED)


@pytest.fixture(scope="module")
def healthy() -> SampleFrame:
    return recorded()


def examined(
    machine: Machine, frame: SampleFrame, unread: tuple[str, ...] | None = None
) -> dict[str, Finding]:
    return {each.name: each for each in check_plausibility(machine, [frame], unread)}


def forbidding(
    machine: Machine, frame: SampleFrame, unread: tuple[str, ...] | None = None
) -> dict[str, str]:
    found = examined(machine, frame, unread)
    return {name: each.sentence for name, each in found.items() if each.forbids}


def without(frame: SampleFrame, *names: str) -> SampleFrame:
    left = {name: values for name, values in frame.channels.items() if name not in names}
    return SampleFrame(frame.time_s, left)


@pytest.mark.parametrize("axis", [BENCH, SLOW, HANGING], ids=["bench", "1.5 rad/s", "hangs"])
def test_axes_that_are_right_are_refused_nothing(axis: PlainAxis) -> None:
    found = examined(axis.machine(), axis.frame())
    assert not [each for each in found.values() if each.is_doubtful]
    assert found["torque"].verdict is Verdict.FITS


@pytest.mark.parametrize("axis", [BENCH, SLOW], ids=["bench", "1.5 rad/s"])
@pytest.mark.parametrize("offset_nm", [0.0, 0.02])
def test_the_amount_of_a_current_is_no_torque(axis: PlainAxis, offset_nm: float) -> None:
    frame = changed(axis.frame(), TORQUE, lambda x: np.abs(x) + offset_nm)
    (sentence,) = forbidding(axis.machine(), frame).values()
    assert "one side both ways" in sentence and "a magnitude, not a load that hangs" in sentence


def test_one_speed_cannot_tell_an_amount_from_a_hanging_load() -> None:
    time_s = np.arange(20_000) / 1000.0
    way = np.sign(np.sin(2.0 * math.pi * time_s / 4.0))
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(way))
    channels = {ANGLE: np.cumsum(10.0 * way) / 1000.0, TORQUE: 1.0 + 0.1 * way + noise}
    found = examined(MACHINE, SampleFrame(time_s, channels))["torque"]
    assert found.is_doubtful and not found.forbids
    assert "or a load that hangs" in found.sentence


@pytest.mark.parametrize("axis", [BENCH, SLOW], ids=["bench", "1.5 rad/s"])
def test_friction_that_drives_is_refused(axis: PlainAxis) -> None:
    frame = axis.frame()
    way = np.sign(np.gradient(frame.channels[ANGLE]))
    pushed = changed(frame, TORQUE, lambda x: x - 2.0 * axis.coulomb_nm * way)
    assert "negative" in forbidding(axis.machine(), pushed)["torque"]


@pytest.mark.parametrize(("unit", "factor"), [("milli", 1e3), ("micro", 1e6), ("nano", 1e9)])
@pytest.mark.parametrize("lacks", [(), SPEEDS, (TORQUE,)], ids=["all", "no speeds", "no torque"])
def test_a_clock_that_counts_no_seconds_is_named(
    unit: str, factor: float, lacks: tuple[str, ...], healthy: SampleFrame
) -> None:
    frame = without(healthy, *lacks)
    frame = SampleFrame(factor * frame.time_s, frame.channels)
    assert f"time_s looks like {unit}seconds" in forbidding(MACHINE, frame)["rate"]


@pytest.mark.parametrize(
    "header", ["Torque [Nm]", "CURRENT|3", "i_q", "Moment", "Strom A", "Last %"]
)
def test_an_unknown_header_of_a_torque_is_named(header: str, healthy: SampleFrame) -> None:
    found = forbidding(MACHINE, without(healthy, TORQUE), ("tool", header))
    assert repr(header) in found["columns"] and "'tool'" not in found["columns"]
    assert forbidding(MACHINE, healthy, ("tool", header)) == {}


@pytest.mark.parametrize("value", [0.0, 0.3, math.nan])
def test_a_device_that_is_off_is_named(value: float, healthy: SampleFrame) -> None:
    off = {name: np.full(len(healthy), value) for name in (TORQUE, ANGLE, TABLE_POSITION)}
    found = forbidding(MACHINE, SampleFrame(healthy.time_s, off))
    assert "the device is off" in found["signals"]
    stuck = changed(healthy, TORQUE, lambda x: np.full(len(x), value))
    assert TORQUE in forbidding(MACHINE, stuck)["signals"]


def late(values: Floats) -> Floats:
    """First-order lag of 0.6 s: a third of the travel is missing in short moves."""
    found = np.empty_like(values)
    found[0] = values[0]
    for k in range(1, len(values)):
        found[k] = found[k - 1] + (values[k] - found[k - 1]) / 600.0
    return found


def steps(follow: Callable[[Floats], Floats], gain: float) -> SampleFrame:
    time_s = np.arange(60_000) / 1000.0
    setpoint = 0.4 + 0.2 * np.repeat([0.0, 1.0, 0.5, -1.0, 0.3, -0.7], 10_000)
    position = gain * follow(setpoint)
    noise = 1e-7 * np.random.default_rng(1).standard_normal(len(position))
    return SampleFrame(time_s, {SETPOINT: setpoint, TABLE_POSITION: position + noise})


def test_a_lag_is_no_wrong_lead_but_a_wrong_scale_is() -> None:
    found = examined(MACHINE, steps(late, 1.0))["setpoint"]
    assert found.verdict is Verdict.FITS and "at rest" in found.sentence
    half = examined(MACHINE, steps(late, 0.5))["setpoint"]
    assert half.is_doubtful and "2 times too small" in half.sentence
    assert "setpoint" in forbidding(MACHINE, steps(late, 1000.0))


@pytest.mark.parametrize(
    ("channel", "factor"), [(TORQUE, 0.0), (TORQUE, -1.0), (TABLE_POSITION, 1.3), (ANGLE, 1.1)]
)
def test_what_goes_wrong_midway_is_a_fault_and_not_a_unit(
    channel: str, factor: float, healthy: SampleFrame
) -> None:
    rows = np.arange(len(healthy)) > 0.6 * len(healthy)
    frame = changed(healthy, channel, lambda x: np.where(rows, factor * x, x))
    assert forbidding(MACHINE, frame) == {}


def test_a_limit_of_the_machine_file_is_held() -> None:
    frame, machine = BENCH.frame(), BENCH.machine()
    for top_rad_s, doubtful in ((BENCH.top_rad_s, False), (0.3 * BENCH.top_rad_s, True)):
        axis = machine.axis.model_copy(update={"max_speed_rad_s": top_rad_s})
        found = examined(machine.model_copy(update={"axis": axis}), frame)["limits"]
        assert found.is_doubtful == doubtful


def test_every_check_says_what_it_compares_and_what_to_do(healthy: SampleFrame) -> None:
    frame = changed(healthy, TEMPERATURE, lambda x: x + 273.0)
    for each in check_plausibility(MACHINE, [frame], ("tool",)):
        assert each.compared
        assert bool(each.remedy) == each.is_doubtful
    assert len({check.name for check in CHECKS}) == len(CHECKS)
