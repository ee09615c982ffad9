"""Status of the mixture estimator: where no number may stand, slow sources among it."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import chain, cycle

import numpy as np
import pytest

from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages import samples
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import PHASES, Fault, FeatureBlock
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Move

from ...bench.estimator.axis import FRAME_ROWS, downsampled
from ...bench.estimator.healthy.production_cases import without_table
from ...cases.case_file import Edit
from .production import AXIS, FRESH, answers_to, held, machine, misled, numbers, production, run


def moved_then(table_m: Callable[[Floats], Floats], seconds: float) -> list[PreloadEstimate]:
    """20 s of production until a dwell, then a motion around where that ended."""
    percent = np.full(FRAME_ROWS * 2, FRESH)
    frames = list(AXIS.frames("production", percent, 6))
    target = frames[-1].channels[samples.SETPOINT]
    until = next(i for i in range(150, len(target)) if np.ptp(target[i - 150 : i]) == 0.0)
    begin_s = float(frames[-1].time_s[until])
    frames[-1] = frames[-1].part(slice(until))
    last = {name: float(column[-1]) for name, column in frames[-1].channels.items()}
    time_s, ratio = np.arange(round(seconds * 1e3)) / 1e3, machine().transmission_ratio_m_per_rad
    noise = np.random.default_rng(9).standard_normal((4, len(time_s)))
    rest = {
        samples.TORQUE: 0.05 + 0.02 * noise[0],
        samples.ANGLE: last[samples.ANGLE] + table_m(time_s) / ratio + 5e-6 * noise[1],
        samples.MOTOR_SPEED: np.gradient(table_m(time_s), 1e-3) / ratio + 0.01 * noise[2],
        samples.TABLE_POSITION: last[samples.TABLE_POSITION] + table_m(time_s) + 5e-8 * noise[3],
        samples.TABLE_SPEED: np.gradient(table_m(time_s), 1e-3) + 5e-5 * noise[2],
        samples.SETPOINT: last[samples.SETPOINT] + table_m(time_s),
    }
    rested = SampleFrame(begin_s + time_s, rest)
    return run(downsampled([*frames, rested], machine()))


def resting(time_s: Floats) -> Floats:
    return np.zeros_like(time_s)


def jogging(time_s: Floats) -> Floats:
    """Steps of 50 micrometres within 20 ms, to and fro, once a second."""
    eased = np.clip((time_s % 1.0) / 0.02, 0.0, 1.0)
    odd = np.floor(time_s) % 2.0 > 0.0
    return np.asarray(5e-5 * np.where(odd, 1.0 - eased, eased))


@pytest.mark.parametrize("table_m", [resting, jogging])
def test_a_number_stands_for_ten_seconds_without_motion_and_no_longer(table_m):
    estimates = moved_then(table_m, 15.0)
    late = [e for e in estimates if e.time_s > 30.0]
    assert {e.status for e in late} == {EstimateStatus.INSUFFICIENT_EXCITATION}
    assert all(e.preload_percent is None and e.low is None and e.reasons for e in late)
    held = [e for e in estimates if 20.5 < e.time_s < 29.0]
    assert {e.status for e in held} == {EstimateStatus.ESTIMATED}


@pytest.mark.parametrize("scale", [{TORQUE: np.nan}, {TORQUE: -1.0}, {ANGLE: -1.0}, {ANGLE: 2.0}])
def test_what_contradicts_the_model_gives_a_reason_instead_of_a_number(scale):
    late = [e for e in answers_to(Edit(scale=scale), 20.0) if e.time_s > 10.0]
    assert all(e.preload_percent is None and e.reasons for e in late)


SPEEDS = (samples.MOTOR_SPEED, samples.TABLE_SPEED)
HARMLESS = {
    "values missing": Edit(missing=[TORQUE, ANGLE, TABLE_POSITION, *SPEEDS], share=0.05),
    "lead wrong by 1 %": Edit(scale={ANGLE: 1.01}),
    "torque with another zero": Edit(shift={TORQUE: 0.3}),
    "one encoder, torque with another zero": Edit(shift={TORQUE: -0.4}),
} | {name: Edit(stuck=[name], between_s=(20.0, 35.0)) for name in (TORQUE, ANGLE, TABLE_POSITION)}


@pytest.mark.parametrize("name", HARMLESS)
def test_what_is_spoiled_misleads_nobody(name: str) -> None:
    answers = numbers(answers_to(HARMLESS[name], one_encoder=name.startswith("one encoder")))
    assert len(answers) > 100
    assert held(answers, FRESH) > 0.94


@pytest.mark.parametrize("edit", [Edit(old_rows={ANGLE: 3}), Edit(held_rows={TABLE_POSITION: 2})])
def test_a_quiet_second_mends_no_gross_disagreement(edit: Edit) -> None:
    assert misled(numbers(answers_to(edit, 120.0)), FRESH) == 0.0


@pytest.mark.parametrize(("seed", "grease"), [(7, 0.8), (8, 1.2), (102, 1.0)])
def test_an_axis_that_is_tested_by_shaking_has_lost_nothing(seed: int, grease: float) -> None:
    frames = AXIS.frames("chirp", np.full(24_000, FRESH), seed, lubricant=grease)
    answers = numbers(run(downsampled(frames, machine())))
    assert held(answers, FRESH) == 1.0
    assert answers[:, 1].min() > 0.8 * FRESH


@pytest.mark.parametrize(("share", "span_s"), [(1.0, 40), (0.7, 300), (0.4, 40), (0.1, 40)])
def test_strokes_at_one_place_mislead_nobody(
    share: float, span_s: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only braking lasts, with an inertia force as large as the friction of the guide."""
    strokes = (Move(way_m, 0.3, 4.0, 200.0) for way_m in chain([0.3], cycle((0.005, -0.005))))
    monkeypatch.setitem(MOTIONS, "strokes", lambda *_: strokes)
    frames = AXIS.frames("strokes", np.full(1000 * span_s, share * FRESH), 5)
    assert misled(numbers(run(downsampled(frames, machine()))), share * FRESH) == 0.0


@pytest.mark.parametrize("interval_s", [0.02, 0.005])
def test_shorter_intervals_hold_the_truth_as_well(interval_s: float) -> None:
    frames = AXIS.frames("production", np.full(20_000, FRESH), 6)
    answers = numbers(run(downsampled(frames, machine(), interval_s)))
    assert len(answers) > 10.0 / interval_s
    assert held(answers, FRESH) > 0.94


def shifted(block: FeatureBlock, by_m: float) -> FeatureBlock:
    phases = {
        name: replace(phase, table_m=phase.table_m + by_m)
        for name in PHASES
        if (phase := getattr(block, name)).steady_s > 0.0
    }
    return replace(block, **phases)


def test_it_goes_on_while_the_linear_encoder_is_missing_and_when_it_is_back() -> None:
    blocks = [without_table(b) if 20.0 < b.time_s < 40.0 else b for b in production("healthy")]
    answers = numbers(run(blocks))
    assert len(answers) > 550
    assert held(answers, FRESH) > 0.94


@pytest.mark.parametrize("by_m", [5e-5, -1e-3])
def test_a_linear_encoder_that_comes_back_elsewhere_is_no_loss(by_m: float) -> None:
    blocks = production("healthy")
    back = next(k for k, b in enumerate(blocks) if b.time_s > 30.0)
    moved = [without_table(b) for b in blocks[back - 20 : back]]
    moved += [shifted(b, by_m) for b in blocks[back:]]
    moved[20] = replace(moved[20], fault=moved[20].fault | Fault.TABLE_SHIFTED)
    answers = numbers(run([*blocks[: back - 20], *moved]))
    assert len(answers) > 550
    assert held(answers[answers[:, 0] > 30.0], FRESH) > 0.94


def test_an_axis_with_both_encoders_can_begin_without_its_table() -> None:
    answers = numbers(run([without_table(block) for block in production("healthy")]))
    assert len(answers) > 550
    assert held(answers, FRESH) > 0.94


def test_it_goes_on_after_an_interrupt_once_motion_is_seen() -> None:
    blocks, estimator = production("healthy"), MixturePreloadEstimator(machine())
    before = run(blocks[:300], estimator)[-1]
    estimator.interrupt()
    said = run(blocks[300:], estimator)
    back = next(e for e in said if e.preload_percent is not None)
    assert back.time_s < 33.0
    assert back.preload_percent == pytest.approx(before.preload_percent, abs=0.3)
    assert back.data_used_s > 20.0


@pytest.mark.parametrize(("swing_nm", "withdrawn"), [(0.02, False), (0.1, True)])
def test_a_torque_that_swings_widens_the_number_or_withdraws_it(swing_nm, withdrawn):
    frames = list(AXIS.frames("production", np.full(FRAME_ROWS * 2, FRESH), 8))
    usual = numbers(run(downsampled(frames, machine())))
    for frame in frames:
        frame.channels[samples.TORQUE] += swing_nm * np.sin(9.0 * frame.time_s)
    shaken = run(downsampled(frames, machine()))
    assert any(each.status is EstimateStatus.INVALID for each in shaken) == withdrawn
    assert np.median(numbers(shaken)[:, 2]) < np.median(usual[:, 2])


def thinned(frames: Iterator[SampleFrame], every: int, of: Machine) -> list[FeatureBlock]:
    """Blocks of every n-th sample: points of what goes on, as a slow poll reads them."""
    downsampler = Downsampler(DownsampleSettings(), of.transmission_ratio_m_per_rad)
    blocks, begin = [], 0
    for frame in frames:
        blocks += downsampler.push(frame.part(slice(-begin % every, None, every)))
        begin += len(frame)
    return blocks


def own(percent: float, seed: int, every: int) -> list[FeatureBlock]:
    return thinned(AXIS.frames("production", np.full(90_000, percent), seed), every, AXIS.nominal())


@cache
def slow_machine(every: int) -> Machine:
    return commissioned([own(FRESH, 3, every)], AXIS.nominal())


def test_samples_slower_than_those_of_commissioning_are_not_read() -> None:
    said = run(own(FRESH, 5, 10))
    assert not len(numbers(said))
    assert all(each.status is not EstimateStatus.INVALID for each in said)
    moved = [each for each in said if each.time_s > 5.0]
    assert {each.status for each in moved} == {EstimateStatus.UNESTIMATED}
    assert all(each.reasons[0].startswith("too_slow: 100 samples/s") for each in moved)


def test_slow_samples_in_between_leave_a_number_for_a_while_and_no_accusation() -> None:
    quick, slow = own(FRESH, 6, 1)[:300], own(FRESH, 6, 20)[300:600]
    said = run([*quick, *slow])
    assert said[299].status is EstimateStatus.ESTIMATED
    assert said[-1].status is EstimateStatus.UNESTIMATED
    assert said[-1].reasons[0].startswith("too_slow: 50 samples/s")


@pytest.mark.slow
@pytest.mark.parametrize("every", [10, 20])
@pytest.mark.parametrize("share", [1.0, 0.6, 0.3])
def test_an_axis_commissioned_from_slow_samples_is_read_from_them(every: int, share: float) -> None:
    percent = share * FRESH
    of = slow_machine(every)
    assert of.commissioned is not None
    assert of.commissioned.sample_period_s == pytest.approx(every / 1000.0)
    answers = numbers(run(own(percent, 7, every), MixturePreloadEstimator(of)))
    late = answers[answers[:, 0] > 20.0]
    assert len(late) > 500
    assert held(late, percent) > 0.95
