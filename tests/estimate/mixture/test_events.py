"""Events that the mixture estimator must see, and those that it must not."""

from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.offline.reproduce.simulation import ThesisCase, run_case

from ...bench.estimator.axis import OwnAxis, downsampled
from ...bench.estimator.plants.thesis import thesis_blocks, thesis_estimator, thesis_machine
from .mixture_axis import COMPLIANCE
from .production import AXIS, FRESH, held, machine, misled, numbers, production, run


def test_the_truth_lies_in_the_interval_of_a_healthy_axis() -> None:
    answers = numbers(run(production("healthy")))
    assert len(answers) > 550
    inside = (answers[:, 2] <= FRESH) & (answers[:, 3] >= FRESH)
    assert inside.mean() > 0.94
    late = answers[answers[:, 0] > 30.0]
    assert np.abs(late[:, 1] - FRESH).max() < 0.8
    assert (late[:, 3] - late[:, 2]).mean() < 2.0


def test_a_one_point_step_is_found() -> None:
    answers = numbers(run(production("step")))
    before = answers[(answers[:, 0] > 25.0) & (answers[:, 0] < 30.0)]
    after = answers[answers[:, 0] > 45.0]
    assert before[:, 1].mean() - after[:, 1].mean() == pytest.approx(1.0, abs=0.6)
    assert held(after, FRESH - 1.0) > 0.9
    late = answers[answers[:, 0] > 55.0]
    assert late[:, 3].mean() < before[:, 3].mean()


def test_a_full_drop_is_seen_within_two_seconds_of_motion() -> None:
    answers = numbers(run(production("drop")))
    assert (answers[answers[:, 0] < 30.0, 1] > 0.5 * FRESH).all()
    assert (answers[(answers[:, 0] > 32.0), 1] < 0.5 * FRESH).all()


@pytest.mark.parametrize("seed", [6, 7])
@pytest.mark.parametrize("left", [0.3, 0.4, 0.6])
@pytest.mark.parametrize("one_encoder", [False, True])
def test_part_of_a_loss_is_not_read_as_all_of_it(one_encoder: bool, left: float, seed: int) -> None:
    axis = replace(AXIS, one_encoder=one_encoder)
    percent = np.where(np.arange(80_000) < 40_000, FRESH, left * FRESH)
    blocks = downsampled(axis.frames("production", percent, seed), axis.nominal())
    answers = numbers(run(blocks, MixturePreloadEstimator(machine(one_encoder))))
    after = answers[answers[:, 0] > 46.0]
    assert len(after) > 300
    assert misled(after, left * FRESH) == 0.0
    if not one_encoder:
        assert after[-1, 1] < 0.95 * FRESH


@pytest.mark.parametrize("left", [0.3, 0.4, 0.6])
def test_with_one_encoder_a_loss_moves_the_answer_and_warmth_stays_possible(left: float) -> None:
    axis = replace(AXIS, one_encoder=True)
    percent = np.where(np.arange(80_000) < 40_000, FRESH, left * FRESH)
    blocks = downsampled(axis.frames("production", percent, 6), axis.nominal())
    answers = numbers(run(blocks, MixturePreloadEstimator(machine(True))))
    before, after = answers[answers[:, 0] < 39.0], answers[answers[:, 0] > 55.0]
    assert after[:, 1].mean() < before[:, 1].mean()
    assert after[:, 2].mean() < before[:, 2].mean() - 0.15 * FRESH
    assert (after[:, 3] > 0.85 * FRESH).all()


def test_a_load_and_a_lubricant_that_change_in_motion_are_no_loss() -> None:
    """No stop is seen before the load, and automatic lubrication needs none."""
    time_s = np.arange(120_000) / 1e3
    frames = AXIS.frames(
        "production",
        np.full(len(time_s), FRESH),
        7,
        lubricant=np.where(time_s < 40.0, 1.0, 0.8),
        added_mass_kg=np.where(time_s < 30.0, 0.0, 5.0),
    )
    answers = numbers(run(downsampled(frames, AXIS.nominal())))
    assert misled(answers, FRESH) == 0.0
    late = answers[answers[:, 0] > 60.0]
    assert held(late, FRESH) > 0.94


def test_another_load_on_an_axis_under_gravity_is_no_lasting_force() -> None:
    axis, load_kg = OwnAxis(1, hanging_n=-196.0), np.where(np.arange(45_000) < 25_000, 0.0, 8.0)
    loads = {"external_force_n": -9.81 * load_kg, "added_mass_kg": load_kg}
    moved = axis.produced(np.full(45_000, FRESH), 5, (), 1.0, [(23.0, 4.0)], **loads)
    answers = numbers(run(moved.blocks, MixturePreloadEstimator(axis.commissioned()))[-100:])
    assert len(answers) > 90
    assert held(answers, FRESH) == 1.0


def test_friction_that_comes_and_goes_is_no_loss() -> None:
    drag = np.repeat([1.0, 1.6, 1.0], [20_000, 40_000, 20_000])
    answers = numbers(run(AXIS.produced(np.full(80_000, FRESH), 5, (), drag).blocks))
    assert misled(answers, FRESH) == 0.0


def test_with_one_encoder_a_drop_of_friction_leaves_both_causes_open() -> None:
    """Torque cannot tell a lost preload from a lubricated axis: no number misses the truth."""
    estimator = MixturePreloadEstimator(machine(one_encoder=True))
    answers = numbers(run(production("drop", one_encoder=True), estimator))
    before, after = answers[answers[:, 0] < 30.0], answers[answers[:, 0] > 35.0]
    assert held(before, FRESH) > 0.94
    assert len(after) > 100
    assert misled(after, 0.0) == 0.0


@pytest.mark.parametrize("one_encoder", [False, True])
@pytest.mark.parametrize("changed_nm", [0.12, -0.08])
def test_a_relubrication_is_no_loss_and_not_the_end_of_numbers(
    changed_nm: float, one_encoder: bool
) -> None:
    """After a stop: a third more friction, or a fifth less."""
    axis, count = replace(AXIS, one_encoder=one_encoder), 30_000
    frames = list(axis.frames("production", np.full(count, FRESH), 6))
    effect = f"drag_error:change_nm={changed_nm}"
    for frame in axis.frames("production", np.full(2 * count, FRESH), 8, (effect,)):
        frames.append(replace(frame, time_s=frame.time_s + 40.0))
    estimator = MixturePreloadEstimator(machine(one_encoder))
    estimates = run(downsampled(frames, axis.nominal()), estimator)
    answers = numbers(estimates)
    late = answers[answers[:, 0] > 50.0]
    assert len(late) > 400
    assert misled(late, FRESH) < 0.02
    assert held(late, FRESH) > 0.9
    assert estimates[-1].fault_probability["process_force"] < 0.5


@pytest.mark.parametrize("force_n", [200.0, -200.0])
@pytest.mark.parametrize("one_encoder", [False, True])
def test_process_forces_are_no_loss(one_encoder: bool, force_n: float) -> None:
    """Cuts of 3 s with 3 s between them, from the tenth second on."""
    axis, time_s = replace(AXIS, one_encoder=one_encoder), np.arange(60_000) / 1e3
    cut = np.where((time_s > 10.0) & (time_s % 6.0 < 3.0), force_n, 0.0)
    frames = axis.frames("production", np.full(len(time_s), FRESH), 6, external_force_n=cut)
    estimator = MixturePreloadEstimator(machine(one_encoder))
    answers = numbers(run(downsampled(frames, axis.nominal()), estimator))
    late = answers[answers[:, 0] > 20.0]
    assert len(late) > 300
    assert held(late, FRESH) > 0.94


def test_an_axis_that_only_cuts_says_so_and_not_that_it_stands() -> None:
    cut = np.where(np.arange(60_000) > 30_000, 300.0, 0.0)
    frames = AXIS.frames("production", np.full(len(cut), FRESH), 6, external_force_n=cut)
    last = run(downsampled(frames, AXIS.nominal()))[-1]
    assert last.status is EstimateStatus.INSUFFICIENT_EXCITATION
    assert [reason.split(":")[0] for reason in last.reasons] == ["process_force"]


@pytest.mark.parametrize("force_n", [400.0, -400.0])
def test_a_cut_of_a_minute_ends_without_a_loss(force_n: float) -> None:
    """Nothing is taught for so long that the first phases after it fit badly."""
    time_s = np.arange(100_000) / 1e3
    cut = np.where((time_s > 25.0) & (time_s < 90.0), force_n, 0.0)
    frames = AXIS.frames("production", np.full(len(time_s), FRESH), 3, external_force_n=cut)
    answers = numbers(run(downsampled(frames, AXIS.nominal())))
    late = answers[answers[:, 0] > 90.0]
    assert len(late) > 30
    assert misled(late, FRESH) == 0.0
    assert late[:, 1].min() > 0.85 * FRESH


def test_warm_up_is_no_wear() -> None:
    """Friction falls by a fifth: on torque alone that reads as a loss of 3.6 points."""
    taught = machine().commissioned
    assert taught is not None
    faded_nm = 0.2 * taught.coulomb_nm
    warm = f"warmup:excess_nm={faded_nm},time_constant_s=60"
    effects = (f"drag_error:change_nm={-faded_nm}", warm)
    frames = AXIS.frames("production", np.full(200_000, FRESH), 8, effects)
    answers = numbers(run(downsampled(frames, AXIS.nominal())))
    late = answers[answers[:, 0] > 60.0]
    assert FRESH - late[:, 1].min() < 0.7
    assert np.mean(late[:, 3] >= FRESH) > 0.94


def test_the_drop_of_the_thesis_is_seen_in_the_third_informative_step() -> None:
    """Steps in which the drag may hold the axis tell nothing."""
    simulated, _ = run_case(ThesisCase(4), seed=3)
    blocks, estimator = thesis_blocks(simulated), thesis_estimator(thesis_machine())
    percents = {e.time_s: e.preload_percent for e in run(blocks, estimator)}
    before = [p for time_s, p in percents.items() if 10.0 < time_s < 50.15 and p is not None]
    assert min(before) > 9.5
    informative = [block.time_s for block in blocks if block.time_s > 50.15 and block.phases]
    after = [percents[time_s] for time_s in informative[2:]]
    assert max(p for p in after if p is not None) < 5.0


HEALTHY_S, STOPPED_S, CHANGED_S = 40.0, 5.0, 60.0
PAYLOAD = "10 kg on the table"


def answer_to(effect: str, seed: int = 7) -> PreloadEstimate:
    """Production, healthy at first; then, after a stop, the axis has the effect."""
    percent = np.full(round(1000 * CHANGED_S), FRESH)
    frames = list(AXIS.frames("production", percent[: round(1000 * HEALTHY_S)], seed))
    effects = (effect,) if effect != PAYLOAD else ()
    loads = {"added_mass_kg": np.full(len(percent), 10.0)} if effect == PAYLOAD else {}
    frames += [
        replace(frame, time_s=frame.time_s + HEALTHY_S + STOPPED_S)
        for frame in AXIS.frames("production", percent, seed + 1, effects, **loads)
    ]
    return run(downsampled(frames, machine()))[-1]


@pytest.mark.parametrize(
    ("effect", "fault"),
    [
        ("drag_error:change_nm=0.12", "lubrication"),
        ("compliance:level_m_per_n=4e-9", "looseness"),
        (PAYLOAD, "payload"),
    ],
)
def test_each_change_is_named_by_its_name(effect: str, fault: str) -> None:
    said = answer_to(effect)
    assert said.fault_probability[fault] > 0.9
    assert said.fault_probability["preload_loss"] < 0.5
    assert said.low is not None
    assert said.high is not None
    assert said.low <= FRESH <= said.high


@pytest.mark.parametrize(("share", "seed"), [(1.0, 20), (1.0, 22), (1.0, 24), (0.1, 24)])
def test_an_axis_that_gets_softer_by_a_joint_has_lost_nothing(share: float, seed: int) -> None:
    """By a broken element of a coupling it yields twice as much, by a slack one a little more."""
    said = answer_to(f"compliance:level_m_per_n={share * COMPLIANCE}", seed)
    assert share < 1.0 or said.fault_probability["looseness"] > 0.9
    assert said.preload_percent is not None
    assert said.preload_percent > 0.9 * FRESH


@pytest.mark.parametrize(
    "effect", ["quadratic_friction", "torque_ripple:amplitude_nm=0.08", "encoder_eccentricity"]
)
def test_what_no_preload_explains_is_not_read_as_one(effect: str) -> None:
    said = answer_to(effect)
    if said.low is None or said.high is None:
        assert said.reasons[0].partition(":")[0] in ("model_mismatch", "process_force")
    else:
        assert said.low <= FRESH <= said.high
