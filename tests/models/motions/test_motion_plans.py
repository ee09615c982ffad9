"""Every named motion: what it promises, and that it keeps to the axis."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import (
    MOTIONS,
    Dwell,
    MotionError,
    MotionLimits,
    Move,
    Plan,
    Segment,
    Setpoints,
    motion_limits,
)

RATE_HZ = 1000.0
BENCH = MotionLimits(0.04, 0.76)
ENDLESS = ("production", "warmup")
FINITE = tuple(name for name in MOTIONS if name not in ENDLESS)
OF_MOVES = ("standstill", "reversals", "friction", "signature", "acceleration")
TABLE_5_1_MM_PER_MIN = (300, 600, 1200, 2400, 3000, 6000, 12000, 24000, 30000, 60000)


def plan_of(name: str, limits: MotionLimits = BENCH, seed: int = 1, **wishes: Any) -> Plan:
    return MOTIONS[name].plan(limits, np.random.default_rng(seed), **wishes)


def sampled(plan: Plan, limits: MotionLimits, rate_hz: float = RATE_HZ) -> np.ndarray:
    count = sum(math.ceil(each.duration_s * rate_hz) for each in plan.segments) + 1
    return Setpoints(iter(plan.segments), limits.low_m, rate_hz).take(count)


def with_starts(plan: Plan, limits: MotionLimits) -> Iterator[tuple[float, Segment]]:
    start_m = limits.low_m
    for segment in plan.segments:
        yield start_m, segment
        start_m += segment.distance_m


def changed(machine: Machine, **axis: float) -> MotionLimits:
    return motion_limits(machine.model_copy(update={"axis": machine.axis.model_copy(update=axis)}))


AXES = st.fixed_dictionaries(
    {
        "stroke_m": st.floats(0.01, 3.0),
        "lead_m": st.sampled_from([0.0025, 0.01, 0.02, 0.04]),
        "max_speed_rad_s": st.floats(20.0, 700.0),
        "max_acceleration_m_s2": st.floats(0.2, 20.0),
        "max_torque_nm": st.floats(0.4, 50.0),
    }
)
ONE_MACHINE = [HealthCheck.function_scoped_fixture]


@pytest.mark.parametrize("name", OF_MOVES)
@given(axis=AXES, jerk_m_s3=st.floats(5.0, 2000.0), clip=st.booleans())
@settings(max_examples=25, deadline=None, suppress_health_check=ONE_MACHINE)
def test_moves_keep_every_limit_or_are_refused_in_one_line(
    name: str, machine: Machine, axis: dict[str, float], jerk_m_s3: float, clip: bool
) -> None:
    limits = replace(changed(machine, **axis), jerk_m_s3=jerk_m_s3)
    try:
        plan = plan_of(name, limits, clip=clip)
    except MotionError as error:
        assert str(error).startswith(f"{name}")
        assert "asks for" in str(error)
        assert "the axis allows" in str(error)
        assert "\n" not in str(error)
        return
    assert clip or not plan.left_out
    assert_within(sampled(plan, limits, 203.0), limits, machine, axis["lead_m"])


@pytest.mark.parametrize("name", ["chirp", "multisine", *ENDLESS])
@given(axis=AXES)
@settings(max_examples=5, deadline=None, suppress_health_check=ONE_MACHINE)
def test_others_keep_every_limit_too(name: str, machine: Machine, axis: dict[str, float]) -> None:
    limits = changed(machine, **axis)
    several_s = 10.0 * (limits.span_m / limits.rapid_m_s + 1.0)
    plan = plan_of(name, limits, duration_s=several_s if name in ENDLESS else None)
    assert_within(sampled(plan, limits, 53.0), limits, machine, axis["lead_m"])


def assert_within(
    setpoints: np.ndarray, limits: MotionLimits, machine: Machine, lead_m: float
) -> None:
    position, speed, acceleration = setpoints.T
    model, ratio = machine.model, lead_m / (2.0 * math.pi)
    torque = np.abs(
        model.inertia_kg_m2.value * acceleration / ratio
        + model.viscous_nm_s_per_rad.value * speed / ratio
        + 0.146 * np.sign(speed)
    )
    assert limits.low_m - 1e-9 <= position.min()
    assert position.max() <= limits.high_m + 1e-9
    assert np.abs(speed).max() <= limits.speed_m_s * (1.0 + 1e-6)
    assert np.abs(acceleration).max() <= limits.acceleration_m_s2 * (1.0 + 1e-6)
    assert torque.max() <= limits.torque_nm * (1.0 + 1e-6)


@pytest.mark.parametrize("name", FINITE)
def test_a_finite_motion_ends_at_rest_where_it_began(name: str) -> None:
    last = sampled(plan_of(name), BENCH, 500.0)[-1]
    assert last == pytest.approx([BENCH.low_m, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("name", OF_MOVES)
def test_position_speed_and_acceleration_are_continuous(name: str) -> None:
    position, speed, acceleration = sampled(plan_of(name), BENCH).T
    h = 1.0 / RATE_HZ
    assert np.abs(np.diff(acceleration)).max() <= BENCH.jerk_m_s3 * h * (1.0 + 1e-6)
    mean_speed = 0.5 * (speed[1:] + speed[:-1])
    # a segment ends between two samples: up to one sample of rest, where little is left to travel
    assert np.abs(np.diff(position) - h * mean_speed).max() <= BENCH.jerk_m_s3 * h**3
    assert np.abs(np.diff(speed)).max() <= BENCH.acceleration_m_s2 * h * (1.0 + 1e-6)


def test_the_full_protocol_runs_every_test_cold_and_the_signature_warm() -> None:
    whole = plan_of("full").segments
    for name in OF_MOVES:
        part = plan_of(name).segments[1:-1]
        keys = [(type(each), round(each.distance_m, 12)) for each in part]
        found = [(type(each), round(each.distance_m, 12)) for each in whole]
        runs = sum(found[i : i + len(keys)] == keys for i in range(len(found)))
        assert runs == (2 if name == "signature" else 1), name
    tests_s = sum(plan_of(n).duration_s for n in (*OF_MOVES, "chirp", "multisine", "signature"))
    assert plan_of("full").duration_s == pytest.approx(tests_s + 120.0 + 60.0, rel=0.02)


@pytest.mark.parametrize("name", ENDLESS)
def test_an_endless_motion_takes_the_time_it_is_given_and_ends_at_rest(name: str) -> None:
    assert MOTIONS[name].duration_s(BENCH) is None
    assert plan_of(name, duration_s=90.0).duration_s == pytest.approx(90.0)
    setpoints = sampled(plan_of(name, duration_s=90.0), BENCH)
    assert setpoints[-1, 1:] == pytest.approx([0.0, 0.0])
    assert np.ptp(setpoints[:, 0]) > 0.5
    with pytest.raises(MotionError, match=f"{name}: does not end by itself; expected a duration"):
        plan_of(name)
    with pytest.raises(MotionError, match=r"first move takes longer than 0\.001 s"):
        plan_of(name, duration_s=1e-3)


def test_a_longer_duration_ends_in_standing_still_and_a_shorter_one_is_refused() -> None:
    natural_s = plan_of("friction").duration_s
    longer = plan_of("friction", duration_s=natural_s + 5.0)
    assert longer.segments[:-1] == plan_of("friction").segments
    assert longer.segments[-1] == Dwell(pytest.approx(5.0))
    with pytest.raises(MotionError, match=r"friction: takes 131\.\d s, a duration of 60 s would"):
        plan_of("friction", duration_s=60.0)


@pytest.mark.parametrize("name", ["multisine", "production", "full"])
def test_chance_is_in_the_generator_alone(name: str) -> None:
    runs = [
        sampled(plan_of(name, seed=s, duration_s=20.0 if name in ENDLESS else None), BENCH, 50.0)
        for s in (3, 3, 4)
    ]
    assert runs[0].tobytes() == runs[1].tobytes()
    assert runs[0].tobytes() != runs[2].tobytes()


def test_friction_turns_the_screw_whole_times_at_each_speed_of_table_5_1_both_ways() -> None:
    found = set()
    for segment in plan_of("friction").segments:
        if isinstance(segment, Move):
            cruise_s = segment.phases_s[2]
            turns = segment.speed_m_s * (cruise_s - 0.1) / 0.02
            if round(turns) >= 1 and turns == pytest.approx(round(turns), abs=1e-6):
                mm_per_min = round(segment.speed_m_s * 60_000.0)
                found.add(math.copysign(mm_per_min, segment.distance_m))
    assert found >= {sign * each for each in TABLE_5_1_MM_PER_MIN for sign in (1.0, -1.0)}


def test_reversals_are_of_the_stated_sizes_at_three_positions_from_either_side() -> None:
    steps = [
        (round(start_m, 9), round(each.distance_m * 1e6))
        for start_m, each in with_starts(plan_of("reversals"), BENCH)
        if 0.0 < abs(each.distance_m) < 3e-3
    ]
    sizes = (20, 60, 200, 600, 2000)
    expected = [
        step
        for station in (0.16, 0.4, 0.64)
        for way in (1, -1)
        for size in sizes
        for step in ((station, -way * size), (round(station - way * size * 1e-6, 9), way * size))
    ]
    assert steps == expected


def test_acceleration_is_held_all_along_the_stroke_at_three_levels_both_ways() -> None:
    position, speed, acceleration = sampled(plan_of("acceleration"), BENCH).T
    for level in (1.0, 2.0, 4.0):
        for way in (1.0, -1.0):
            held = np.isclose(np.abs(acceleration), level) & (way * speed > 0.0)
            share = np.histogram(position[held], np.linspace(0.04, 0.76, 11))[0]
            assert (share > 20).all(), (level, way)


# What limits the axis, and what is refused: left out, asked for and allowed.
REFUSALS = [
    # 100 rad/s at 20 mm lead
    ("max_speed_rad_s", 100.0, "friction, 1200 r/min over 1 rev: speed", "24000", "19100 mm/min"),
    # 1 rev at 1 m/s, 0.1 s to settle, 1 / 4 + 4 / 200 s to rise at a mean of half the speed, twice
    ("stroke_m", 0.4, "friction, 3000 r/min over 1 rev: stroke", "390", "360 mm"),
    # half of the torque for inertia; 5e-3 * 314.16 viscous and 0.146 drag
    ("max_torque_nm", 3.0, "friction, 3000 r/min over 1 rev: torque", "3.217", "3 N m"),
    # 20 rev at 0.04 m/s, 0.1 s to settle, 2 sqrt(0.04 / 200) s to rise
    ("stroke_m", 0.4, "signature, 120 r/min over 20 rev: stroke", "405.1", "360 mm"),
    # 5 times 2 * (0.01 + 0.02) m/s over 0.02 + 0.02 s of rise; 1 m/s2 still fits
    ("stroke_m", 0.01, "acceleration, 2 m/s2 held for 0.02 s in 5 sections: stroke", "12", "9 mm"),
    ("stroke_m", 0.03, "reversals", "30", "27 mm"),
    ("stroke_m", 0.06, "standstill", "60", "54 mm"),
]


@pytest.mark.parametrize(("limit", "value", "what", "asked", "allowed"), REFUSALS)
def test_a_refusal_says_which_limit_what_was_asked_and_what_is_allowed(
    limit: str, value: float, what: str, asked: str, allowed: str, machine: Machine
) -> None:
    unit = allowed.partition(" ")[2]
    with pytest.raises(MotionError, match=f"{what}.* {asked} {unit}, the axis allows {allowed}"):
        plan_of(what.partition(",")[0], changed(machine, **{limit: value}))


def test_clipping_leaves_out_and_names_what_the_axis_does_not_allow(machine: Machine) -> None:
    plan = plan_of("friction", changed(machine, max_speed_rad_s=100.0), clip=True)
    assert [line.split(":")[0] for line in plan.left_out] == [
        f"friction, {rpm} r/min over 1 rev" for rpm in (1200, 1500, 3000)
    ]
    fastest = max(each.peak_speed_m_s for each in plan.segments)
    assert fastest == pytest.approx(100.0 * 0.02 / (2.0 * math.pi))
    speeds = {round(60_000.0 * each.peak_speed_m_s) for each in plan.segments}
    assert speeds >= set(TABLE_5_1_MM_PER_MIN[:7])
    with pytest.raises(MotionError, match="signature: nothing is left of it; signature, 120 r/min"):
        plan_of("signature", changed(machine, stroke_m=0.2), clip=True)


@pytest.mark.parametrize("name", ["friction", "reversals"])
def test_the_simulated_axis_follows(name: str, machine: Machine) -> None:
    limits = motion_limits(machine)
    plan = plan_of(name, limits)
    setpoints = sampled(plan, limits)
    drive = FeedDrive(FeedDriveSettings.of_machine(machine, RATE_HZ), limits.low_m, 6.846, 1)
    channels = drive.advance(setpoints, np.full(len(setpoints), 6.846)).channels
    error_m = np.abs(channels["table_position_m"] - setpoints[:, 0])
    assert np.abs(channels["torque_command_nm"]).max() <= limits.torque_nm
    assert error_m.max() < 50e-6
    start = 0
    for segment in plan.segments:
        count = math.ceil(segment.duration_s * RATE_HZ)
        settled = slice(start + count // 2, start + count)
        if isinstance(segment, Dwell):
            assert error_m[settled].max() < 1e-6
        elif isinstance(segment, Move) and segment.phases_s[2] > 0.15:
            jerk_s, hold_s, cruise_s = segment.phases_s
            first, last = 2 * jerk_s + hold_s + 0.1, 2 * jerk_s + hold_s + cruise_s
            cruise = slice(start + math.ceil(first * RATE_HZ), start + int(last * RATE_HZ))
            assert error_m[cruise].max() < 1e-6
        start += count
