"""Units and signs: what is put in wrong is named, with a number whose interval holds it."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from edge_service.checks.examination import check_plausibility
from edge_service.checks.finding import Finding, Verdict
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import (
    ANGLE,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
    Floats,
    SampleFrame,
)
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits

MACHINE = load_machine(DEFAULT_MACHINE)
FRESH = 6.85


def recorded(machine: Machine = MACHINE, *effects: str, rows: int = 15_000) -> SampleFrame:
    """Production motion of the simulated axis at 1 kHz."""
    limits = motion_limits(machine)
    segments = MOTIONS["production"](limits, np.random.default_rng(3))
    setpoints = Setpoints(segments, limits.low_m, 1000.0).take(rows)
    settings = FeedDriveSettings.of_machine(machine, 1000.0, [parse_effect(e) for e in effects])
    return FeedDrive(settings, limits.low_m, FRESH, 3).advance(setpoints, np.full(rows, FRESH))


@pytest.fixture(scope="module")
def healthy() -> SampleFrame:
    return recorded()


def changed(frame: SampleFrame, channel: str, how: Callable[[Floats], Floats]) -> SampleFrame:
    return SampleFrame(frame.time_s, {**frame.channels, channel: how(frame.channels[channel])})


def found(frame: SampleFrame, machine: Machine = MACHINE) -> dict[str, Finding]:
    return {finding.name: finding for finding in check_plausibility(machine, [frame])}


def doubts(findings: dict[str, Finding]) -> dict[str, str]:
    return {
        name: each.sentence for name, each in findings.items() if each.verdict is Verdict.DOUBTFUL
    }


def test_an_axis_that_is_what_it_says_raises_no_doubt(healthy: SampleFrame) -> None:
    findings = found(healthy)
    assert {each.verdict for each in findings.values()} == {Verdict.FITS}
    assert len(findings) == 10
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
def test_faults_of_the_mechanics_are_no_mistakes_of_the_configuration(
    effects: tuple[str, ...],
) -> None:
    assert doubts(found(recorded(MACHINE, *effects))) == {}


CASES: dict[str, tuple[str, Callable[[Floats], Floats], str, str]] = {
    "torque the other way": (TORQUE, lambda x: -x, "torque", "torque sign looks inverted"),
    "torque in percent": (TORQUE, lambda x: 100.0 * x, "torque", "percent instead of a fraction"),
    "torque in mN m": (TORQUE, lambda x: 1e3 * x, "torque", "thousandths instead of whole units"),
    "angle the other way": (ANGLE, lambda x: -x, "lead", "motor_angle_rad looks inverted"),
    "angle in degrees": (
        ANGLE,
        np.degrees,
        "lead",
        "motor_angle_rad looks 57.3 times too large (degrees instead of radians",
    ),
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
    "position the other way": (
        TABLE_POSITION,
        lambda x: -x,
        "setpoint",
        "table_position_m looks inverted",
    ),
    "speed in rev/min": (
        MOTOR_SPEED,
        lambda x: x * 60.0 / (2.0 * math.pi),
        "motor_speed",
        "motor_speed_rad_s looks 9.549 times too large (rev/min instead of rad/s",
    ),
    "temperature in K": (TEMPERATURE, lambda x: x + 273.0, "temperature", "from 293 to 293"),
    "position from another zero": (
        TABLE_POSITION,
        lambda x: x - 0.4,
        "stroke",
        "of a stroke of 0.8 m",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_mistake_of_unit_or_sign_is_named(name: str, healthy: SampleFrame) -> None:
    channel, how, check, expected = CASES[name]
    findings = found(changed(healthy, channel, how))
    assert expected in doubts(findings)[check]
    if channel != TORQUE:
        assert "torque" not in doubts(findings)


@pytest.mark.parametrize("lead_m", [0.01, 0.005, 0.04])
def test_another_lead_is_named_with_its_value(lead_m: float) -> None:
    axis = MACHINE.axis.model_copy(update={"lead_m": lead_m})
    frame = recorded(MACHINE.model_copy(update={"axis": axis}))
    finding = found(frame)["lead"]
    assert finding.verdict is Verdict.DOUBTFUL
    assert f"lead looks like {1e3 * lead_m:.4g} mm, not 20" in finding.sentence
    assert finding.figure is not None
    assert finding.figure.value == pytest.approx(1e3 * lead_m, rel=1e-4)


@pytest.mark.parametrize("skew_s", [0.8e-3, 3e-3, -0.5e-3])
def test_a_late_encoder_is_named_with_its_lag(skew_s: float) -> None:
    finding = found(recorded(MACHINE, f"timestamp_skew:skew_s={skew_s}"))["encoder_lag"]
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
    findings = found(still)
    assert doubts(findings) == {}
    for name in ("lead", "setpoint", "torque", "encoder_lag"):
        assert findings[name].verdict is Verdict.UNKNOWN
        assert "tell" in findings[name].sentence


@pytest.mark.parametrize("every", [20, 100])
def test_slow_samples_are_called_slow_and_nothing_else(healthy: SampleFrame, every: int) -> None:
    slow = SampleFrame(
        healthy.time_s[::every], {n: v[::every] for n, v in healthy.channels.items()}
    )
    assert set(doubts(found(slow))) <= {"rate"}
    assert ("rate" in doubts(found(slow))) == (every > 20)


def test_channels_that_are_not_there_are_not_judged(healthy: SampleFrame) -> None:
    only = SampleFrame(healthy.time_s, {TORQUE: healthy.channels[TORQUE]})
    findings = found(only)
    assert set(findings) == {"rate", "signals", "torque"}
    assert findings["torque"].verdict is Verdict.UNKNOWN
