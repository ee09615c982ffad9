"""The fused estimator: exact where theory says so, honest where it does not."""

import inspect
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.estimate import (
    fused,
    fused_answers,
    fused_begin,
    fused_kernel,
    fused_mixture,
    fused_model,
    fused_physics,
    fused_predict,
    fused_state,
)
from edge_service.estimate.fused import FusedPreloadEstimator, vibrates
from edge_service.estimate.fused_model import FusedSettings, drift_of, start_of
from edge_service.estimate.fused_state import PRELOAD, STATES, Mixture
from edge_service.messages.channels import (
    ANGLE,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TABLE_SPEED,
    TORQUE,
)
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import FeatureBlock, Phase
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.machine import Machine
from edge_service.studies.estimator_axis import FRAME_ROWS, OwnAxis, downsampled
from edge_service.studies.estimator_hostile import CASES, spoiled
from edge_service.studies.estimator_seed import SETTINGS, thesis_blocks, thesis_machine
from edge_service.studies.thesis_runs import ThesisCase, run_case

AXIS = OwnAxis(1)
FRESH = AXIS.fresh_percent
RATIO = AXIS.nominal().transmission_ratio_m_per_rad


@cache
def machine(one_encoder: bool = False) -> Machine:
    return OwnAxis(1, one_encoder=one_encoder).commissioned()


@cache
def production(name: str, seconds: float = 60.0, one_encoder: bool = False) -> list[FeatureBlock]:
    """Blocks of a production run in which something happens at half time."""
    count = round(seconds * 1e3)
    after = np.arange(count) >= count // 2
    percent = np.full(count, FRESH)
    loads: dict[str, Floats] = {}
    if name == "step":
        percent -= after
    elif name == "drop":
        percent[after] = 0.0
    elif name == "payload":
        loads["added_mass_kg"] = np.where(after, 10.0, 0.0)
    axis = replace(AXIS, one_encoder=one_encoder)
    return downsampled(axis.frames("production", percent, 6, **loads), axis.nominal())


def run(
    blocks: Sequence[FeatureBlock], estimator: FusedPreloadEstimator | None = None
) -> list[PreloadEstimate]:
    estimator = estimator or FusedPreloadEstimator(machine())
    estimates = []
    for block in blocks:
        estimator.update(block)
        estimates.append(estimator.estimate())
    return estimates


def numbers(estimates: Sequence[PreloadEstimate]) -> Floats:
    """Time, preload, low, high of those that have a number, (n, 4)."""
    rows = [(e.time_s, e.preload_percent, e.low, e.high) for e in estimates]
    return np.array([row for row in rows if row[1] is not None], dtype=np.float64)


def mixture_of(estimator: FusedPreloadEstimator) -> Mixture:
    return estimator._mixture


# what theory says


def in_sigmas(mixture: Mixture) -> Floats:
    """Means of the hypotheses over their standard deviations."""
    alive = int(mixture.alive[0])
    variance = np.einsum("kii->ki", mixture.covariance[:alive])
    sigma = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    return np.asarray(mixture.mean[:alive] / sigma)


def test_plain_python_gives_the_same_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Over a run in which hypotheses are born, merge and die: a drop at half time."""
    blocks = [b for b in production("drop", 60.0) if 28.5 < b.time_s < 31.5]
    compiled = FusedPreloadEstimator(machine())
    begun = mixture_of(compiled).alive[0]
    run(blocks, compiled)
    assert (mixture_of(compiled).kind[: mixture_of(compiled).alive[0]] >= 0).any()
    rooms = (fused_physics, fused_predict, fused_mixture, fused_kernel, fused_answers, fused)
    kernels = {
        name: value.py_func
        for room in rooms
        for name, value in inspect.getmembers(room)
        if hasattr(value, "py_func")
    }
    assert len(kernels) > 20
    for room in rooms:
        for name, python in kernels.items():
            if hasattr(room, name):
                monkeypatch.setattr(room, name, python)
    assert inspect.isfunction(fused.take)
    plain = FusedPreloadEstimator(machine())
    run(blocks, plain)
    assert mixture_of(plain).alive[0] < begun
    assert_alike(mixture_of(plain), mixture_of(compiled), 1e-10)  # rounding of 90 steps
    plain.restore(json.loads(json.dumps(compiled.snapshot())))
    following = production("drop")[315:318]
    plain_last = run(following, plain)[-1]
    monkeypatch.undo()
    compiled_last = run(following, compiled)[-1]
    assert_alike(mixture_of(plain), mixture_of(compiled), 1e-12)
    assert plain_last.preload_percent == pytest.approx(compiled_last.preload_percent, rel=1e-12)


def assert_alike(mine: Mixture, other: Mixture, tolerance: float) -> None:
    """The same hypotheses, means within a share of their standard deviations."""
    rows = slice(0, int(other.alive[0]))
    assert mine.alive[0] == other.alive[0]
    for name in ("mode", "kind"):
        np.testing.assert_array_equal(getattr(mine, name)[rows], getattr(other, name)[rows])
    for name in ("log_weight", "force", "age_s"):
        first, second = getattr(mine, name)[rows], getattr(other, name)[rows]
        np.testing.assert_allclose(first, second, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(in_sigmas(mine), in_sigmas(other), rtol=tolerance, atol=tolerance)


def test_permuting_the_hypotheses_changes_nothing() -> None:
    blocks = production("step")
    straight, turned = FusedPreloadEstimator(machine()), FusedPreloadEstimator(machine())
    run(blocks[:250], straight)
    run(blocks[:250], turned)
    mixture = mixture_of(turned)
    count = int(mixture.alive[0])
    assert count > 2
    order = np.random.default_rng(3).permutation(count)
    for array in mixture:
        if len(array) == fused_state.CAPACITY:
            array[:count] = array[order]
    first, second = run(blocks[250:], straight), run(blocks[250:], turned)
    assert [e.status for e in first] == [e.status for e in second]
    np.testing.assert_allclose(numbers(first), numbers(second), rtol=1e-6, atol=1e-6)


def test_without_jumps_it_is_a_plain_kalman_filter() -> None:
    """One encoder makes the balance linear; the filter below shares no code with the kernel."""
    none = 1e-300
    quiet = FusedSettings(
        loss_hazard=none,
        friction_hazard=none,
        payload_hazard=none,
        wear_hazard=none,
        backlash_hazard=none,
        misalignment_hazard=none,
        gain_hazard=none,
        force_hazard=none,
        process_force_n=1e9,
        unchanged=0.0,
    )
    axis_machine = machine(one_encoder=True)
    estimator = FusedPreloadEstimator(axis_machine, quiet)
    blocks = production("healthy", one_encoder=True)
    mean, covariance, most = plain_kalman(axis_machine, quiet, blocks)
    run(blocks, estimator)
    assert most < 20.0  # no outlier was widened
    mixture = mixture_of(estimator)
    assert mixture.alive[0] == 1
    np.testing.assert_allclose(mixture.mean[0], mean, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(mixture.covariance[0], covariance, rtol=1e-10, atol=1e-14)


def plain_kalman(
    axis_machine: Machine, chosen: FusedSettings, blocks: Sequence[FeatureBlock]
) -> tuple[Floats, Floats, float]:
    """u = J a + D v + A |v| + s (k p + R G + B + St(v)) + R^2 dM a + b, one step per phase."""
    taught, per_percent = axis_machine.commissioned, axis_machine.drag_per_percent_nm
    assert taught is not None
    assert per_percent is not None
    ratio = axis_machine.transmission_ratio_m_per_rad
    model = fused_model.fused_model(axis_machine, chosen)
    start, drift = start_of(axis_machine, model, chosen), drift_of(axis_machine, model, chosen)
    mean, covariance = start.mean.copy(), start.beginnings[0][1].copy()
    mean[PRELOAD] = FRESH
    covariance[PRELOAD, PRELOAD] = (fused_begin.SIGMA_SHARE * FRESH) ** 2
    last_s: float | None = None
    most = 0.0
    for block in blocks:
        if not block.usable or vibrates(block):
            continue
        for phase in block.phases:
            elapsed_s = block.duration_s if last_s is None else block.time_s - last_s
            last_s = block.time_s
            moved = np.where(drift.moving, phase.steady_s, elapsed_s)
            covariance = covariance + np.diag(drift.walk**2 * moved)
            s, v, a = block.steady_direction, phase.speed_rad_s, phase.acceleration_rad_s2
            slow = taught.stribeck_excess_nm * math.exp(-abs(v) / taught.stribeck_speed_rad_s)
            h = np.zeros(STATES)
            h[fused_state.PRELOAD], h[fused_state.DRY] = s * per_percent, s
            if not math.isnan(phase.table_m):
                raise AssertionError("expected one encoder")
            h[fused_state.GUIDE], h[fused_state.VISCOUS] = s * ratio, v
            h[fused_state.ASYMMETRY], h[fused_state.MASS] = abs(v), ratio**2 * a
            h[fused_state.OFFSET], h[fused_state.GAIN] = 1.0, -phase.torque_nm
            noise = taught.noise_density_nm2_s * (1.0 + (taught.noise_slow_rad_s / v) ** 2)
            variance = noise / phase.steady_s + (0.3 * slow) ** 2
            known = axis_machine.model.inertia_kg_m2.value * a + s * slow
            innovation = phase.torque_nm - known - h @ mean
            spread = h @ covariance @ h + variance
            gain = covariance @ h / spread
            mean = mean + gain * innovation
            covariance = covariance - np.outer(gain, h @ covariance)
            most = max(most, float(innovation**2 / spread))
    return mean, covariance, most


@pytest.mark.parametrize("case", ["drop", "payload"])
def test_a_restored_estimator_goes_on_bit_equal(case: str) -> None:
    blocks = production(case)
    half = len(blocks) // 2 + 5
    first = FusedPreloadEstimator(machine())
    run(blocks[:half], first)
    second = FusedPreloadEstimator(machine())
    second.restore(json.loads(json.dumps(first.snapshot(), allow_nan=False)))
    for mine, other in zip(run(blocks[half:], first), run(blocks[half:], second), strict=True):
        assert mine.model_dump_json() == other.model_dump_json()
    assert first.snapshot() == second.snapshot()


def test_a_foreign_snapshot_is_refused() -> None:
    with pytest.raises(ValueError, match="snapshot"):
        FusedPreloadEstimator(machine()).restore({"schema": "imm-preload/1"})


def test_a_snapshot_of_another_axis_is_refused_and_changes_nothing() -> None:
    two, one = FusedPreloadEstimator(machine()), FusedPreloadEstimator(machine(one_encoder=True))
    run(production("healthy")[:100], two)
    run(production("healthy", one_encoder=True)[:100], one)
    before = one.snapshot()
    with pytest.raises(ValueError, match="another axis"):
        one.restore(two.snapshot())
    assert one.snapshot() == before


def test_reset_forgets_everything() -> None:
    blocks = production("healthy")[:200]
    used = FusedPreloadEstimator(machine())
    run(production("drop"), used)
    used.reset()
    assert run(blocks, used) == run(blocks)


@cache
def begun(one_encoder: bool) -> dict[str, Any]:
    """Snapshot after 40 good intervals."""
    estimator = FusedPreloadEstimator(machine(one_encoder))
    run(production("healthy", one_encoder=one_encoder)[:40], estimator)
    return estimator.snapshot()


ANY = st.floats(allow_nan=True, allow_infinity=True)
PHASE = st.builds(
    Phase,
    steady_s=st.floats(1e-4, 1.0),
    torque_nm=ANY,
    acceleration_rad_s2=ANY,
    speed_rad_s=ANY,
    angle_rad=ANY,
    table_m=ANY,
)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(PHASE, st.sampled_from([-1.0, 1.0]), ANY), min_size=1, max_size=6),
    st.booleans(),
)
def test_garbage_never_yields_a_number_that_is_none(
    garbage: list[tuple[Phase, float, float]], one_encoder: bool
) -> None:
    """Between good intervals: every number of every estimate is finite, also long after."""
    good = production("healthy", one_encoder=one_encoder)
    estimator = FusedPreloadEstimator(machine(one_encoder))
    estimator.restore(begun(one_encoder))
    dirty = [
        replace(
            good[40],
            time_s=good[40].time_s + 0.1 * number,
            cruising=phase,
            accelerating=Phase(),
            braking=Phase(),
            steady_direction=direction,
            external_force_n=force,
        )
        for number, (phase, direction, force) in enumerate(garbage)
    ]
    for estimate in run([*dirty, *good[47:55]], estimator):
        told = (estimate.preload_percent, estimate.low, estimate.high, estimate.nis)
        assert all(value is None or math.isfinite(value) for value in told)
        if estimate.preload_percent is not None:
            assert 0.0 <= estimate.low <= estimate.preload_percent <= estimate.high  # type: ignore[operator]
    count = int(mixture_of(estimator).alive[0])
    assert np.isfinite(mixture_of(estimator).mean[:count]).all()
    assert np.isfinite(mixture_of(estimator).covariance[:count]).all()


def test_an_uncommissioned_machine_is_refused() -> None:
    with pytest.raises(ValueError, match="commissioned"):
        FusedPreloadEstimator(AXIS.nominal())


# what it must see, and what it must not


def test_the_truth_lies_in_the_interval_of_a_healthy_axis() -> None:
    told = numbers(run(production("healthy")))
    assert len(told) > 550
    inside = (told[:, 2] <= FRESH) & (told[:, 3] >= FRESH)
    assert inside.mean() > 0.94
    late = told[told[:, 0] > 30.0]
    assert np.abs(late[:, 1] - FRESH).max() < 0.8
    assert (late[:, 3] - late[:, 2]).mean() < 2.0


def test_a_one_point_step_is_found() -> None:
    told = numbers(run(production("step")))
    before = told[(told[:, 0] > 25.0) & (told[:, 0] < 30.0)]
    after = told[told[:, 0] > 45.0]
    assert before[:, 1].mean() - after[:, 1].mean() == pytest.approx(1.0, abs=0.4)
    assert np.mean((after[:, 2] <= FRESH - 1.0) & (after[:, 3] >= FRESH - 1.0)) > 0.94
    assert after[:, 3].mean() < FRESH


def test_a_full_drop_is_seen_within_a_second() -> None:
    told = numbers(run(production("drop")))
    assert (told[told[:, 0] < 30.0, 1] > 0.5 * FRESH).all()
    assert (told[(told[:, 0] > 31.5), 1] < 0.5 * FRESH).all()


def test_with_one_encoder_a_drop_of_friction_leaves_both_causes_open() -> None:
    """Torque cannot tell a lost preload from a lubricated axis: the interval holds either."""
    estimator = FusedPreloadEstimator(machine(one_encoder=True))
    told = numbers(run(production("drop", one_encoder=True), estimator))
    before, after = told[told[:, 0] < 30.0], told[told[:, 0] > 32.0]
    assert np.mean((before[:, 2] <= FRESH) & (before[:, 3] >= FRESH)) > 0.94
    assert after[:, 2].max() < 0.5
    assert (after[:, 1] < before[-1, 1] - 1.0).all()


def test_a_payload_is_no_loss() -> None:
    told = numbers(run(production("payload")))
    before = told[(told[:, 0] > 25.0) & (told[:, 0] < 30.0), 1].mean()
    assert before - told[told[:, 0] > 30.0, 1].min() < 0.5


def test_warm_up_is_no_wear() -> None:
    """Friction falls by a fifth: on torque alone that reads as a loss of 3.6 points."""
    seconds, share = 200.0, 0.2
    taught = machine().commissioned
    assert taught is not None
    faded_nm = share * taught.coulomb_nm
    effects = (
        f"drag_error:change_nm={-faded_nm}",
        f"warmup:excess_nm={faded_nm},time_constant_s={0.3 * seconds}",
    )
    percent = np.full(round(seconds * 1e3), FRESH)
    frames = AXIS.frames("production", percent, 8, effects)
    told = numbers(run(downsampled(frames, AXIS.nominal())))
    late = told[told[:, 0] > 60.0]
    assert FRESH - late[:, 1].min() < 0.7
    assert np.mean(late[:, 3] >= FRESH) > 0.94


def test_published_probabilities_sum_to_one_and_name_the_nearest_level() -> None:
    last = run(production("drop"))[-1]
    assert list(last.mode_probability) == ["10", "7.5", "5", "2.5", "0"]
    assert sum(last.mode_probability.values()) == pytest.approx(1.0)
    assert last.mode_probability["0"] > 0.9


def test_preload_in_newton_and_percent_agree() -> None:
    last = run(production("healthy"))[-1]
    assert last.preload_percent is not None
    assert last.preload_n == pytest.approx(last.preload_percent / 100.0 * 7450.0)
    assert last.drag_torque_nm is not None
    taught = machine().commissioned
    assert taught is not None
    assert last.drag_torque_nm.low < taught.coulomb_nm < last.drag_torque_nm.high


# when no number may stand


def moved_then(table_m: Callable[[Floats], Floats], seconds: float) -> list[PreloadEstimate]:
    """20 s of production until a dwell, then a motion around where that ended."""
    percent = np.full(FRAME_ROWS * 2, FRESH)
    frames = list(AXIS.frames("production", percent, 6))
    target = frames[-1].channels[SETPOINT]
    until = next(i for i in range(150, len(target)) if np.ptp(target[i - 150 : i]) == 0.0)
    begin_s = float(frames[-1].time_s[until])
    frames[-1] = part(frames[-1], until)
    last = {name: float(column[-1]) for name, column in frames[-1].channels.items()}
    time_s = np.arange(round(seconds * 1e3)) / 1e3
    noise = np.random.default_rng(9).standard_normal((4, len(time_s)))
    rest = {
        TORQUE: 0.05 + 0.02 * noise[0],
        ANGLE: last[ANGLE] + table_m(time_s) / RATIO + 5e-6 * noise[1],
        MOTOR_SPEED: np.gradient(table_m(time_s), 1e-3) / RATIO + 0.01 * noise[2],
        TABLE_POSITION: last[TABLE_POSITION] + table_m(time_s) + 5e-8 * noise[3],
        TABLE_SPEED: np.gradient(table_m(time_s), 1e-3) + 5e-5 * noise[2],
        SETPOINT: last[SETPOINT] + table_m(time_s),
    }
    rested = SampleFrame(begin_s + time_s, rest)
    return run(downsampled([*frames, rested], machine()))


def part(frame: SampleFrame, rows: int) -> SampleFrame:
    channels = {name: column[:rows] for name, column in frame.channels.items()}
    return SampleFrame(frame.time_s[:rows], channels)


def resting(time_s: Floats) -> Floats:
    return np.zeros_like(time_s)


def jogging(time_s: Floats) -> Floats:
    """Steps of 50 micrometres within 20 ms, to and fro, once a second."""
    eased = np.clip((time_s % 1.0) / 0.02, 0.0, 1.0)
    odd = np.floor(time_s) % 2.0 > 0.0
    return np.asarray(5e-5 * np.where(odd, 1.0 - eased, eased))


@pytest.mark.parametrize("table_m", [resting, jogging])
def test_a_number_stands_for_ten_seconds_without_motion_and_no_longer(
    table_m: Callable[[Floats], Floats],
) -> None:
    estimates = moved_then(table_m, 15.0)
    late = [e for e in estimates if e.time_s > 30.0]
    assert {e.status for e in late} == {EstimateStatus.INSUFFICIENT_EXCITATION}
    assert all(e.preload_percent is None and e.low is None and e.reasons for e in late)
    held = [e for e in estimates if 20.5 < e.time_s < 29.0]
    assert {e.status for e in held} == {EstimateStatus.ESTIMATED}


def test_no_motion_is_insufficient_excitation_from_the_start() -> None:
    noise = np.random.default_rng(7).standard_normal((2, 3000))
    channels = {TORQUE: 0.02 * noise[0], ANGLE: 5e-6 * noise[1]}
    still = SampleFrame(np.arange(3000) / 1e3, channels)
    estimates = run(downsampled([still], machine()))
    assert {e.status for e in estimates} == {EstimateStatus.INSUFFICIENT_EXCITATION}
    assert {e.preload_percent for e in estimates} == {None}


def test_no_number_outlives_a_long_silence() -> None:
    estimator = FusedPreloadEstimator(machine())
    assert run(production("healthy"), estimator)[-1].status is EstimateStatus.ESTIMATED
    estimator.interrupt()
    assert estimator.estimate().preload_percent is None


WRONG = ("torque missing", "torque sign swapped", "angle sign swapped", "lead wrong by 2")


@pytest.mark.parametrize("name", WRONG)
def test_what_contradicts_the_model_gives_a_reason_instead_of_a_number(name: str) -> None:
    case = next(case for case in CASES if case.name == name)
    estimates = run(spoiled(case, AXIS, machine(), 20.0).blocks)
    late = [e for e in estimates if e.time_s > 10.0]
    assert all(e.preload_percent is None for e in late)
    assert all(e.reasons for e in late)


HARMLESS = ("5 % of all values missing", "linear encoder stuck", "rotary encoder stuck")


@pytest.mark.parametrize("name", HARMLESS)
def test_what_is_spoiled_misleads_nobody(name: str) -> None:
    case = next(case for case in CASES if case.name == name)
    told = numbers(run(spoiled(case, AXIS, machine(), 60.0).blocks))
    assert len(told) > 100
    assert np.mean((told[:, 2] <= FRESH) & (told[:, 3] >= FRESH)) > 0.94


# the seed's own plant


def test_the_seeds_drop_is_seen_in_the_third_informative_step() -> None:
    """Steps in which the drag may hold the axis tell nothing."""
    simulated, _ = run_case(ThesisCase(4), seed=3)
    blocks = thesis_blocks(simulated)
    estimator = FusedPreloadEstimator(thesis_machine(), SETTINGS)
    told = {e.time_s: e.preload_percent for e in run(blocks, estimator)}
    before = [p for time_s, p in told.items() if 10.0 < time_s < 50.15 and p is not None]
    assert min(before) > 9.5
    informative = [block.time_s for block in blocks if block.time_s > 50.15 and block.phases]
    after = [told[time_s] for time_s in informative[2:]]
    assert max(p for p in after if p is not None) < 5.0


def test_frames_of_a_case_hold_its_rows_once() -> None:
    frames: list[Any] = list(AXIS.frames("production", np.full(25_000, FRESH), 6))
    assert [len(frame) for frame in frames] == [FRAME_ROWS, FRAME_ROWS, 5_000]
    assert np.diff(np.concatenate([f.time_s for f in frames])) == pytest.approx(1e-3)
