"""Units and signs that are wrong are named; what forbids an answer is told from faults."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edge_service.checks.examination import CHECKS, check_plausibility
from edge_service.checks.finding import Finding, Verdict
from edge_service.config import DEFAULT_MACHINE, load_machine
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
from ..nodes.conftest import production

MACHINE = load_machine(DEFAULT_MACHINE)
FRESH = 6.85
BENCH = PlainAxis()
SLOW = replace(BENCH, lead_m=0.02, top_rad_s=1.5, acceleration_rad_s2=4.0, encoder_rad=1e-6)
HANGING = replace(BENCH, hanging_nm=6.0)
SPEEDS = (MOTOR_SPEED, TABLE_SPEED)


def recorded(machine: Machine = MACHINE, *effects: str, rows: int = 15_000) -> SampleFrame:
    return production(machine, FRESH, rows, *effects, seed=3)


@pytest.fixture(scope="module")
def healthy() -> SampleFrame:
    return recorded()


def examined(
    machine: Machine, frame: SampleFrame, unread: tuple[str, ...] | None = None
) -> dict[str, Finding]:
    return {each.name: each for each in check_plausibility(machine, [frame], unread)}


def doubts(findings: dict[str, Finding]) -> dict[str, str]:
    return {name: each.sentence for name, each in findings.items() if each.is_doubtful}


def forbidding(
    machine: Machine, frame: SampleFrame, unread: tuple[str, ...] | None = None
) -> dict[str, str]:
    found = examined(machine, frame, unread)
    return {name: each.sentence for name, each in found.items() if each.forbids}


def changed(frame: SampleFrame, channel: str, how: Callable[[Floats], Floats]) -> SampleFrame:
    return SampleFrame(frame.time_s, {**frame.channels, channel: how(frame.channels[channel])})


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


@pytest.mark.parametrize(
    ("stated", "misread", "doubtful"),
    [
        ({"max_speed_rad_s": BENCH.top_rad_s}, 1.0, False),
        ({"max_speed_rad_s": 0.3 * BENCH.top_rad_s}, 1.0, True),
        ({"screw_diameter_m": 0.032}, 1.0, False),
        ({"screw_diameter_m": 0.032}, math.degrees(1.0), True),
    ],
)
def test_a_limit_is_held_that_of_a_screw_if_none_is_stated(
    stated: dict[str, float], misread: float, doubtful: bool
) -> None:
    """Unless a second encoder tells, an angle in degrees shows by nothing else."""
    axis = BENCH.machine().axis.model_copy(update=stated)
    frame = changed(BENCH.frame(), ANGLE, lambda x: misread * x)
    found = examined(BENCH.machine().model_copy(update={"axis": axis}), frame)
    assert ("limits" in doubts(found)) == doubtful


def test_every_check_says_what_it_compares_and_what_to_do(healthy: SampleFrame) -> None:
    frame = changed(healthy, TEMPERATURE, lambda x: x + 273.0)
    for each in check_plausibility(MACHINE, [frame], ("tool",)):
        assert each.compared
        assert bool(each.remedy) == each.is_doubtful
    assert len({check.name for check in CHECKS}) == len(CHECKS)


def test_an_axis_that_is_what_it_says_raises_no_doubt(healthy: SampleFrame) -> None:
    findings = examined(MACHINE, healthy)
    assert {each.verdict for each in findings.values()} == {Verdict.FITS}
    assert len(findings) == 11
    lead = findings["lead"].figure
    assert lead is not None
    assert lead.low <= 20.0 + 1e-3
    assert lead.high >= 20.0 - 1e-3


@pytest.mark.parametrize(
    "effects",
    [
        ("backlash:width_m=1e-5", "stribeck", "thermal_growth", "compliance"),
        ("lead_error", "encoder_eccentricity", "load_offset", "torque_ripple", "delay"),
        ("warmup", "drag_error", "viscous_error", "presliding", "position_friction"),
    ],
)
def test_faults_of_mechanics_are_no_mistakes_of_the_configuration(effects: tuple[str, ...]) -> None:
    assert doubts(examined(MACHINE, recorded(MACHINE, *effects))) == {}


CASES: dict[str, tuple[str, Callable[[Floats], Floats], str, str]] = {
    "torque the other way": (TORQUE, lambda x: -x, "torque", "torque sign looks inverted"),
    "torque in percent": (TORQUE, lambda x: 100.0 * x, "torque", "percent instead of a fraction"),
    "torque in mN m": (TORQUE, lambda x: 1e3 * x, "torque", "thousandths instead of whole units"),
    "angle the other way": (ANGLE, lambda x: -x, "lead", "motor_angle_rad looks inverted"),
    "angle in degrees": (ANGLE, np.degrees, "lead", "_rad looks 57.3 times too large (degrees"),
    "angle in turns": (
        ANGLE,
        lambda x: x / (2.0 * math.pi),
        "lead",
        "motor_angle_rad looks 6.283 times too small (revolutions instead of radians",
    ),
    "position in mm": (
        TABLE_POSITION,
        lambda x: 1e3 * x,
        "setpoint",
        "table_position_m looks 1000 times too large (thousandths instead of whole units",
    ),
    "position back": (TABLE_POSITION, lambda x: -x, "setpoint", "table_position_m looks inverted"),
    "speed in rev/min": (
        MOTOR_SPEED,
        lambda x: x * 60.0 / (2.0 * math.pi),
        "motor_speed",
        "motor_speed_rad_s looks 9.549 times too large (rev/min instead of rad/s",
    ),
    "temperature in K": (TEMPERATURE, lambda x: x + 273.0, "temperature", "from 293 to 293"),
    "position elsewhere": (TABLE_POSITION, lambda x: x - 0.4, "stroke", "of a stroke of 0.8 m"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_mistake_of_unit_or_sign_is_named(name: str, healthy: SampleFrame) -> None:
    channel, how, check, expected = CASES[name]
    findings = examined(MACHINE, changed(healthy, channel, how))
    assert expected in doubts(findings)[check]
    if channel != TORQUE:
        assert "torque" not in doubts(findings)


@pytest.mark.parametrize("lead_m", [0.01, 0.005, 0.04])
def test_another_lead_is_named_with_its_value(lead_m: float) -> None:
    axis = MACHINE.axis.model_copy(update={"lead_m": lead_m})
    finding = examined(MACHINE, recorded(MACHINE.model_copy(update={"axis": axis})))["lead"]
    assert finding.verdict is Verdict.DOUBTFUL
    assert f"lead looks like {1e3 * lead_m:.4g} mm, not 20" in finding.sentence
    assert finding.figure is not None
    assert finding.figure.value == pytest.approx(1e3 * lead_m, rel=1e-4)


@pytest.mark.parametrize("skew_s", [0.8e-3, 3e-3, -0.5e-3])
def test_a_late_encoder_is_named_with_its_lag(skew_s: float) -> None:
    finding = examined(MACHINE, recorded(MACHINE, f"timestamp_skew:skew_s={skew_s}"))["encoder_lag"]
    assert finding.verdict is Verdict.DOUBTFUL
    which = "lags" if skew_s > 0.0 else "leads"
    assert finding.sentence == f"linear encoder {which} rotary by {abs(1e3 * skew_s):.2g} ms"
    assert finding.figure is not None
    assert finding.figure.value == pytest.approx(1e3 * skew_s, abs=0.002)


def test_an_axis_at_rest_tells_nothing_and_says_so(healthy: SampleFrame) -> None:
    random = np.random.default_rng(1)
    time_s = np.arange(2000) / 1000.0
    still = SampleFrame(
        time_s,
        {
            TORQUE: 0.1 + 0.01 * random.standard_normal(2000),
            ANGLE: 3.0 + 5e-6 * random.standard_normal(2000),
            TABLE_POSITION: 0.1 + 5e-8 * random.standard_normal(2000),
            SETPOINT: np.full(2000, 0.1),
        },
    )
    findings = examined(MACHINE, still)
    assert doubts(findings) == {}
    for name in ("lead", "setpoint", "torque", "encoder_lag"):
        assert findings[name].verdict is Verdict.UNKNOWN
        assert "tell" in findings[name].sentence


@pytest.mark.parametrize("each", [20, 100])
def test_slow_samples_are_called_slow_and_nothing_else(healthy: SampleFrame, each: int) -> None:
    slow = SampleFrame(healthy.time_s[::each], {n: v[::each] for n, v in healthy.channels.items()})
    assert set(doubts(examined(MACHINE, slow))) <= {"rate"}
    assert ("rate" in doubts(examined(MACHINE, slow))) == (each > 20)


def test_channels_that_are_not_there_are_not_judged(healthy: SampleFrame) -> None:
    findings = examined(MACHINE, SampleFrame(healthy.time_s, {TORQUE: healthy.channels[TORQUE]}))
    assert set(findings) == {"rate", "signals", "samples", "torque"}
    assert findings["torque"].verdict is Verdict.UNKNOWN
