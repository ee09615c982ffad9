"""Causes are named on recordings from a plant that shares no code with the library."""

import math

import numpy as np
import pytest

from edge_service.diagnose.candidates.regressors import candidates_of, unobservable
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import SUREST, Diagnosis, NamedEffect, ParameterValue, Verdict
from edge_service.diagnose.session.session import Session
from edge_service.diagnose.validation.assessment import is_told
from edge_service.models.effects.registry import effects, get_effect
from edge_service.models.machine import Machine
from edge_service.offline.report.diagnosis_page import verdict_sentence

from .conftest import frame_of, recorded, session_of

_KNOWN: dict[object, tuple[Diagnosis, Session]] = {}


def diagnosed(
    machine: Machine, causes: tuple[str, ...], seed: int, withheld: tuple[str, ...] = ()
) -> tuple[Diagnosis, Session]:
    """A diagnosis, made once for all tests that look at it."""
    key = causes, seed, withheld
    if key not in _KNOWN:
        session = session_of(machine, frame_of(recorded(causes, seed)))
        library = [each for each in effects().values() if each.name not in withheld]
        _KNOWN[key] = diagnose_session(session, machine, library), session
    return _KNOWN[key]


def test_a_healthy_axis_has_no_gap(machine: Machine) -> None:
    found, _ = diagnosed(machine, (), seed=3)
    assert found.verdict is Verdict.NO_GAP
    assert found.effects == ()
    assert found.misfit is not None and found.misfit.p_value > 0.5
    doubted = found.model_copy(update={"is_doubted": True})
    assert verdict_sentence(doubted).startswith("Where the recording can be trusted")


@pytest.mark.parametrize("cause", ["drag_error", "torque_ripple", "timestamp_skew"])
def test_a_single_cause_is_named(machine: Machine, cause: str) -> None:
    found, _ = diagnosed(machine, (cause,), seed=3)
    assert found.verdict is Verdict.EXPLAINED
    assert [each.name for each in found.effects] == [cause]
    assert 0.9 < found.effects[0].probability <= SUREST
    assert found.misfit is not None and found.misfit.p_value < 1e-3
    assert found.misfit.p_value_after > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("cause", sorted(n for n, e in effects().items() if not e.is_fault))
def test_every_cause_leads_the_list(machine: Machine, cause: str) -> None:
    found, _ = diagnosed(machine, (cause,), seed=5)
    before = max(each.before / each.noise_floor for each in found.gap.values())
    if before < 1.5:
        pytest.skip("the motion hardly shows it")
    assert found.effects
    assert found.effects[0].name == cause


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("viscous_error", "drag_error")]


@pytest.mark.parametrize("cause", ["torque_ripple", *SLOW])
def test_what_the_library_lacks_is_unknown(machine: Machine, cause: str) -> None:
    found, _ = diagnosed(machine, (cause,), seed=3, withheld=(cause,))
    assert found.verdict is Verdict.UNKNOWN
    assert all(each.probability < 0.9 for each in found.effects)
    assert found.where


def test_the_found_value_is_the_true_one(machine: Machine) -> None:
    found, _ = diagnosed(machine, ("drag_error",), seed=3)
    truth = recorded(("drag_error",), 3).truth["effects"]["drag_error"]["change_nm"]
    assert found.effects[0].parameters["change_nm"].value == pytest.approx(truth, abs=0.012)


@pytest.mark.slow
def test_the_width_of_a_play_is_found_within_its_interval(machine: Machine) -> None:
    found, _ = diagnosed(machine, ("backlash",), seed=5)
    truth = recorded(("backlash",), 5).truth["effects"]["backlash"]["width_m"]
    width = found.effects[0].parameters["width_m"]
    assert width.low < truth < width.high


def test_what_is_left_is_the_gap_less_the_entries(machine: Machine) -> None:
    found, session = diagnosed(machine, ("torque_ripple",), seed=3)
    for name, gap in found.gap.items():
        assert gap.before == pytest.approx(session.channels[name].rms)
        assert gap.after == pytest.approx(float(np.sqrt(np.mean(found.series.left[name] ** 2))))
        assert gap.after <= gap.before * (1.0 + 1e-9)


def test_a_shape_has_the_interval_of_its_profile(machine: Machine) -> None:
    found, _ = diagnosed(machine, ("torque_ripple",), seed=3)
    (ripple,) = found.effects
    truth = recorded(("torque_ripple",), 3).truth["effects"]["torque_ripple"]
    order, amplitude = ripple.parameters["order"], ripple.parameters["amplitude_nm"]
    assert order.low == order.high == truth["order"]
    bounds = {each.name: each for each in get_effect("torque_ripple").parameters}
    assert bounds["amplitude_nm"].low < amplitude.low < amplitude.high < bounds["amplitude_nm"].high
    phase = ripple.parameters["phase_rad"]
    half = 0.5 * (amplitude.high - amplitude.low) / amplitude.value
    by_gain = 1.645 * machine.model.inertia_kg_m2.tolerance
    assert math.hypot(phase.high - phase.value, by_gain) == pytest.approx(half, rel=1e-6)


def test_a_skew_is_found_within_its_interval(machine: Machine) -> None:
    found, _ = diagnosed(machine, ("timestamp_skew",), seed=3)
    truth = recorded(("timestamp_skew",), 3).truth["effects"]["timestamp_skew"]["skew_s"]
    skew = found.effects[0].parameters["skew_s"]
    # The plant counts how much later the scale is read, the library how far its channel lags.
    assert skew.low < -truth < skew.high
    assert skew.high - skew.low < 0.2 * abs(truth)


def test_one_encoder_shows_nothing_between_two(machine: Machine) -> None:
    session = session_of(machine, frame_of(recorded((), 3), table_position_m=None))
    between = {"backlash", "compliance", "lead_error", "encoder_eccentricity", "timestamp_skew"}
    assert not {each.name for each in candidates_of(session, list(effects().values()))} & between
    assert all("one encoder" in unobservable(session)[name] for name in between)


@pytest.mark.parametrize(("low", "told"), [(-12.0, False), (2.0, True)])
def test_a_value_that_may_be_zero_is_not_told(low: float, told: bool) -> None:
    value = ParameterValue(value=9.4, low=low, high=31.0, unit="m")
    values = {"name": "lead_error", "parameters": {"variation_m": value}, "entries": ({},)}
    assert is_told(NamedEffect.model_construct(**values)) is told
