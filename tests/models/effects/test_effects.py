"""The library: entries, parameters, and what the signatures promise about them."""

import math
import pkgutil
import tomllib

import numpy as np
import pytest
from scipy import signal

from edge_service.config import DEFAULT_MACHINE
from edge_service.messages.samples import SETPOINT, TABLE_POSITION, TEMPERATURE, Floats
from edge_service.models.effects import library
from edge_service.models.effects.baseline import Baseline, Motion
from edge_service.models.effects.contribution import HOUSING_LAG_S, lagged_warming
from edge_service.models.effects.effect import Role
from edge_service.models.effects.hysteresis import bristle_share, play
from edge_service.models.effects.library.warmup import WARM_RISE_K
from edge_service.models.effects.registry import (
    active_effect,
    effect_names,
    get_effect,
    machine_effects,
    parse_effect,
)
from edge_service.models.effects.signature import torque_signature, transmission_signature
from edge_service.models.feed_drive import AMBIENT_C, FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import Dwell, Move, Setpoints

SPRING = "compliance:level_m_per_n=1e-8,friction_share=0.5"
REQUIRED = {
    *("inertia_error", "viscous_error", "drag_error", "torque_gain_error", "stribeck"),
    *("load_offset", "presliding", "position_friction", "compliance", "backlash", "lead_error"),
    *("thermal_growth", "torque_ripple", "encoder_eccentricity", "delay", "timestamp_skew"),
    *("warmup", "external_force"),
}
WITH_AMOUNTS = [
    name
    for name in effect_names()
    if any(parameter.role is Role.AMOUNT for parameter in get_effect(name).parameters)
]
SIGNATURES = (torque_signature, transmission_signature)


@pytest.fixture(scope="module")
def baseline() -> Baseline:
    content = tomllib.loads(DEFAULT_MACHINE.read_text())
    content["model"]["guide_force_n"] = 60.0
    return Baseline.of_machine(Machine.model_validate(content))


@pytest.fixture(scope="module")
def motion(baseline: Baseline) -> Motion:
    """A slow sweep with a swing on top: both directions, many speeds, half of the screw."""
    time_s = np.arange(4000) / 1000.0
    rate = 2.0 * np.pi / 4.0
    angle = 120.0 + 60.0 * np.sin(rate * time_s) + 2.0 * np.sin(7.0 * rate * time_s)
    speed = np.gradient(angle, time_s)
    return Motion.of_samples(
        baseline, time_s, angle, speed, np.gradient(speed, time_s), torque_nm=3.0 * np.cos(time_s)
    )


def test_every_required_effect_is_there_and_every_file_is_found() -> None:
    files = {module.name for module in pkgutil.iter_modules(library.__path__)}
    assert set(effect_names()) == files
    assert files >= REQUIRED


@pytest.mark.parametrize("name", effect_names())
def test_entries_are_complete(name: str) -> None:
    effect = get_effect(name)
    assert effect.description.endswith(".")
    assert effect.description.count(".") == 1
    assert effect.source
    for parameter in effect.parameters:
        assert parameter.unit
        assert parameter.description.endswith(".")
        assert parameter.problem(parameter.low) is None
        assert parameter.problem(parameter.high) is None
        assert parameter.low <= parameter.healthy <= parameter.high
        assert parameter.low <= parameter.faulty <= parameter.high
    assert effect.contributions(effect.complete({}))


@pytest.mark.parametrize("name", effect_names())
def test_signatures_are_finite_and_a_typical_fault_has_one(
    name: str, motion: Motion, baseline: Baseline
) -> None:
    active = parse_effect(name)
    found = [s(active.effect, active.values, motion, baseline) for s in SIGNATURES]
    assert all(values.shape == motion.time_s.shape for values in found)
    assert all(np.isfinite(values).all() for values in found)
    assert any(np.ptp(values) > 0.0 for values in found)


@pytest.mark.parametrize("name", effect_names())
def test_a_healthy_value_has_no_signature(name: str, motion: Motion, baseline: Baseline) -> None:
    effect = get_effect(name)
    healthy = {parameter.name: parameter.healthy for parameter in effect.parameters}
    for signature in SIGNATURES:
        assert not np.any(signature(effect, healthy, motion, baseline))


@pytest.mark.parametrize("name", WITH_AMOUNTS)
def test_amounts_are_proportional_and_add_up(name: str, motion: Motion, baseline: Baseline) -> None:
    effect = get_effect(name)
    typical = effect.complete({})
    amounts = [each.name for each in effect.parameters if each.role is Role.AMOUNT]
    nothing = {**typical, **dict.fromkeys(amounts, 0.0)}
    for signature in SIGNATURES:
        alone = [
            signature(effect, {**nothing, amount: 2.5 * typical[amount]}, motion, baseline)
            for amount in amounts
        ]
        together = signature(effect, typical, motion, baseline)
        np.testing.assert_allclose(sum(alone), 2.5 * together, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        (name, parameter.name)
        for name in effect_names()
        for parameter in get_effect(name).parameters
        if parameter.role is Role.PHASE
    ],
)
def test_phases_mix_a_sine_and_a_cosine(
    name: str, parameter: str, motion: Motion, baseline: Baseline
) -> None:
    effect = get_effect(name)
    fixed = effect.complete({})
    mine = next(each for each in effect.parameters if each.name == parameter).amounts
    if mine:
        others = [p.name for p in effect.parameters if p.role is Role.AMOUNT and p.name not in mine]
        fixed |= {**dict.fromkeys(others, 0.0), **dict.fromkeys(mine, 2e-5)}
    for signature in SIGNATURES:
        begun, turned, sine = (
            signature(effect, {**fixed, parameter: angle}, motion, baseline)
            for angle in (0.0, 0.7, 0.5 * math.pi)
        )
        mixed = math.cos(0.7) * begun + math.sin(0.7) * sine
        np.testing.assert_allclose(turned, mixed, rtol=1e-6, atol=1e-9)


def test_signatures_are_those_of_the_equations(motion: Motion, baseline: Baseline) -> None:
    """The table of the diagnosis, written out by hand for one moment of fast forward motion."""
    k = int(np.argmax(motion.speed_rad_s))
    v, a, x = motion.speed_rad_s[k], motion.acceleration_rad_s2[k], motion.position_m[k]
    r = baseline.ratio_m_per_rad
    c = -float(baseline.wind_up_m(np.array([r]), np.array([x]))[0])
    carried_nm = baseline.table_inertia_kg_m2 * a + baseline.table_coulomb_nm
    stirred_nm = baseline.viscous_nm_s_per_rad * v
    expected = {
        "inertia_error:change_kg_m2=1e-3": (1e-3 * a, -c * 1e-3 * a / r),
        "viscous_error:change_nm_s_per_rad=0.01": (0.01 * v, 0.0),
        "quadratic_friction:coefficient_nm_s2_per_rad2=1e-4": (1e-4 * v * abs(v), 0.0),
        "load_offset:constant_nm=0.3": (0.3, -c * 0.3 / r),
        "position_friction:excess_nm=0.2,centre_m=0.3": (
            0.2 * 2.0 ** (-4.0 * ((x - 0.3) / 0.1) ** 2),
            -c / r * 0.2 * 2.0 ** (-4.0 * ((x - 0.3) / 0.1) ** 2),
        ),
        "lead_error:pitch_error=1e-4": (baseline.table_inertia_kg_m2 * 1e-4 * a, 1e-4 * x),
        "timestamp_skew:skew_s=1e-3": (0.0, -r * v * 1e-3),
        "external_force:force_n=50,start_s=0,duration_s=9": (-r * 50.0, c * 50.0),
        "stribeck:excess_nm=0.2,speed_rad_s=50": (0.2 * math.exp(-((v / 50.0) ** 2)), 0.0),
        "compliance:level_m_per_n=1e-8": (0.0, -1e-8 * carried_nm / r),
        "compliance:level_m_per_n=1e-8,friction_share=0.5,viscous_share=0.4": (
            0.0,
            -1e-8 * (carried_nm - 0.5 * baseline.table_coulomb_nm + 0.4 * stirred_nm) / r,
        ),
        "load_friction:coefficient=0.2": (0.2 * abs(carried_nm), 0.0),
        "load_friction:coefficient=0.2,friction_share=0.0,viscous_share=1.0": (
            0.2 * abs(carried_nm - baseline.table_coulomb_nm + stirred_nm),
            0.0,
        ),
        "backlash": (0.0, 0.0),
    }
    for text, (torque, transmission) in expected.items():
        active = parse_effect(text)
        found = [s(active.effect, active.values, motion, baseline)[k] for s in SIGNATURES]
        assert found == pytest.approx([torque, transmission], rel=1e-6, abs=1e-12), text


def test_friction_is_undetermined_at_rest_and_the_load_is_not(baseline: Baseline) -> None:
    still = np.zeros(5)
    motion = Motion.of_samples(baseline, np.arange(5.0), still + 100.0, still, still)
    for name, size in (("load_offset:constant_nm=0.3", 0.3), ("drag_error:change_nm=0.3", 0.0)):
        active = parse_effect(name)
        torque = torque_signature(active.effect, active.values, motion, baseline)
        assert torque.tolist() == [size] * 5


def test_play_is_one_sided() -> None:
    travel = np.array([0.0, 5.0, 4.0, 2.0, -3.0, -2.5, 6.0])
    never = np.zeros(7, dtype=np.int8)
    assert (play(travel, 2.0, never) - travel).tolist() == [0.0, 0.0, 1.0, 2.0, 2.0, 1.5, 0.0]


def test_a_spring_unwinds_with_the_motor_that_creeps_back(baseline: Baseline) -> None:
    r, reach, back = baseline.ratio_m_per_rad, 4e-6, 1e-6
    travel = np.concatenate((np.linspace(0.0, 1e-3, 2001), [1e-3 - back]))
    still = np.zeros(len(travel))
    speed = np.append(np.ones(len(travel) - 1), 0.0)
    motion = Motion.of_samples(baseline, 1e-3 * np.arange(len(travel)), travel / r, speed, still)
    late, at_once = (
        transmission_signature(each.effect, each.values, motion, baseline)
        for each in (parse_effect(f"{SPRING}{more}") for more in (f",reach_m={reach}", ""))
    )
    wound = 1e-8 * 0.5 * baseline.table_coulomb_nm / r
    assert at_once[-2:] == pytest.approx([-wound, -wound])
    assert late[-2:] == pytest.approx([-wound, -wound * (1.0 - back / reach)])


def test_bristle_follows_the_elasto_plastic_law() -> None:
    """Elastic to half of the level, then d share / dx = 2 (1 - share) / reach."""
    reach = 20e-6
    travel = np.linspace(0.0, 60e-6, 601)
    past = np.maximum(travel - 0.5 * reach, 0.0)
    expected = np.where(
        travel < 0.5 * reach, travel / reach, 1.0 - 0.5 * np.exp(-2.0 * past / reach)
    )
    assert bristle_share(travel, reach) == pytest.approx(expected, abs=3e-3)
    there_and_back = np.concatenate((travel, travel[::-1]))
    back = -1.0 + 0.5 * math.exp(-2.0 * 30e-6 / reach)  # 30 um elastic from 1 to -0.5, 30 um more
    assert bristle_share(there_and_back, reach)[-1] == pytest.approx(back, abs=5e-3)
    small = 2e-6 * np.sin(np.linspace(0.0, 60.0, 5000))
    assert bristle_share(small, reach) == pytest.approx(small / reach, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stribek", r"no effect 'stribek'; did you mean 'stribeck'\?; there are "),
        ("backlash:widht_m=1", r"backlash: no parameter 'widht_m'; did you mean 'width_m'\?"),
        ("backlash:width_m=1", r"backlash: width_m: expected 0 to 0\.002 m, got 1"),
        ("backlash:width_m=nan", "width_m: expected .* got nan"),
        ("backlash:width_m", r"backlash: expected key=number, got 'width_m'"),
        ("backlash:width_m=thick", "expected key=number, got 'width_m=thick'"),
        ("backlash:width_m=0,width_m=0", "width_m is given twice"),
        ("torque_ripple:order=1.5", "order: expected a whole number, got 1.5"),
    ],
)
def test_mistakes_are_one_line(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        parse_effect(text)
    assert "\n" not in str(raised.value)


def test_what_is_not_given_is_typical() -> None:
    assert parse_effect("lead_error").values["pitch_error"] > 0.0
    given = parse_effect("lead_error:amplitude_m=1e-6").values
    amounts = ("amplitude_m", "pitch_error", "variation_m")
    assert {e: given[e] for e in amounts} == dict.fromkeys(amounts, 0.0) | {"amplitude_m": 1e-6}
    assert given["order"] == 1.0
    assert parse_effect("lead_error:order=2").values["amplitude_m"] > 0.0


def test_effects_of_a_machine_file_are_the_same_entries() -> None:
    content = tomllib.loads(DEFAULT_MACHINE.read_text())
    content["effects"] = [
        {"name": "backlash", "parameters": {"width_m": {"value": 4.1e-6, "tolerance": 0.1}}}
    ]
    (found,) = machine_effects(Machine.model_validate(content))
    assert found == active_effect("backlash", {"width_m": 4.1e-6})


HOME_M = 0.04


def temperature_c(machine: Machine, seconds: int, *effects: str) -> Floats:
    settings = FeedDriveSettings.of_machine(machine, 1000.0, [parse_effect(e) for e in effects])
    drive = FeedDrive(settings, HOME_M, 6.8, 1)
    setpoints = np.tile([HOME_M, 0.0, 0.0], (1000 * seconds, 1))
    parts = [drive.advance(part, np.full(len(part), 6.8)) for part in np.array_split(setpoints, 3)]
    return np.concatenate([part.channels[TEMPERATURE] for part in parts])


@pytest.mark.parametrize("time_constant_s", [30.0, HOUSING_LAG_S, 900.0])
def test_the_housing_is_a_first_order_lag_behind_the_screw(time_constant_s: float) -> None:
    time_s = np.linspace(0.0, 3000.0, 30_001)
    screw_k = 10.0 * (1.0 - np.exp(-time_s / time_constant_s))
    _, housing_k, _ = signal.lsim(([1.0], [HOUSING_LAG_S, 1.0]), screw_k, time_s)
    found = lagged_warming(10.0, time_constant_s).rise_k(time_s)
    assert found == pytest.approx(housing_k, abs=0.01)


def test_growth_and_warm_up_warm_one_housing(machine: Machine) -> None:
    growth, friction = "thermal_growth:rise_k=20,time_constant_s=60", "warmup:time_constant_s=60"
    cold = temperature_c(machine, 60)
    assert np.mean(cold) == pytest.approx(AMBIENT_C, abs=0.01)
    late = math.exp(-1.0) * 60.0 - math.exp(-60.0 / HOUSING_LAG_S) * HOUSING_LAG_S
    share = 1.0 - late / (60.0 - HOUSING_LAG_S)
    for effects, rise_k in (
        ((growth,), 20.0),
        ((friction,), WARM_RISE_K),
        ((growth, friction), 20.0),
        (("warmup:excess_nm=0",), 0.0),
    ):
        found = temperature_c(machine, 60, *effects)
        assert np.mean(found[-200:]) == pytest.approx(AMBIENT_C + share * rise_k, abs=0.02)
        assert np.mean(found[:200]) == pytest.approx(AMBIENT_C, abs=0.02)


@pytest.mark.parametrize(("share", "guide_n"), [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0)])
def test_play_hunts_at_rest_only_where_no_friction_holds_the_table(
    machine: Machine, share: float, guide_n: float
) -> None:
    """Two newtons do, or a part of the drag where the machine file states none for the guides."""
    model = machine.model.model_copy(update={"guide_force_n": Quantity(value=guide_n)})
    axis = machine.model_copy(update={"model": model})
    effect = parse_effect(f"backlash:width_m=1e-5,friction_share={share}")
    settings = FeedDriveSettings.of_machine(axis, 1000.0, [effect])
    moves = (Move(0.1, 0.1, 2.0, 200.0), Dwell(3.0), Move(-0.1, 0.1, 2.0, 200.0), Dwell(3.0))
    count = int(1000 * sum(segment.duration_s for segment in moves))
    setpoints = Setpoints(iter(moves), HOME_M, 1000.0).take(count)
    frame = FeedDrive(settings, HOME_M, 6.8, 1).advance(setpoints, np.full(count, 6.8))
    error_m = frame.channels[SETPOINT] - frame.channels[TABLE_POSITION]
    assert (np.ptp(error_m[-1500:]) > 3e-6) == (share == 0.0)
