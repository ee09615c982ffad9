"""The thesis' estimator on a closed-loop axis: follows the truth, and says when it cannot."""

from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.estimate.imm.estimator import ImmPreloadEstimator
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import ANGLE, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine
from tests.estimate.mixture.production import run as estimated
from tests.nodes.conftest import production

MACHINE = load_machine(DEFAULT_MACHINE)
RATE_HZ = 1000.0
Profile = Callable[[Floats], Floats]


@cache
def recording(name: str, seconds: float, seed: int) -> tuple[SampleFrame, Floats]:
    """A production run of the bench, with the true preload at each sample, percent."""
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    preload = PROFILES[name](time_s / seconds)
    return production(MACHINE, preload, len(time_s), seed=seed), preload


PROFILES: dict[str, Profile] = {
    "healthy": lambda share: np.full_like(share, 6.846),
    "gradual": lambda share: 10.0 - 10.0 * share,
    "partial": lambda share: 7.5 - 5.0 * share,
    "fast": lambda share: 10.0 * np.clip(1.4 - 1.75 * share, 0.0, 1.0),
    "sudden": lambda share: np.where(share < 0.5, 10.0, 0.0),
}


def blocks_of(frame: SampleFrame, interval_s: float = 0.1) -> list[FeatureBlock]:
    ratio = MACHINE.transmission_ratio_m_per_rad
    return Downsampler(DownsampleSettings(interval_s=interval_s), ratio).push(frame)


def run(
    blocks: Iterable[FeatureBlock], machine: Machine = MACHINE, **options: Any
) -> list[PreloadEstimate]:
    return estimated(blocks, ImmPreloadEstimator(machine, **options))


def errors(estimates: list[PreloadEstimate], truth: Floats) -> tuple[Floats, float]:
    """Errors in points of those with a number, and the share of truths inside the interval."""
    known = [e for e in estimates if e.preload_percent is not None]
    true = np.array([truth[round(e.time_s * RATE_HZ)] for e in known])
    error = np.array([e.preload_percent for e in known]) - true
    inside = [e.low <= t <= e.high for e, t in zip(known, true, strict=True)]  # type: ignore[operator]
    return error, float(np.mean(inside))


@pytest.mark.parametrize("method", ["kf-imm", "sif-imm"])
@pytest.mark.parametrize("name", ["healthy", "gradual", "partial"])
def test_it_follows_the_true_preload_within_its_interval(name: str, method: str) -> None:
    frame, truth = recording(name, 120.0, 1)
    estimates = run(blocks_of(frame), method=method)
    error, covered = errors(estimates, truth)
    assert len(error) > 0.95 * len(estimates)
    # levels are 2.5 points apart: reading between them to a fifth of that is the method's worth
    assert np.mean(np.abs(error)) < 0.5
    assert covered >= 0.93


def test_the_drag_torque_is_that_of_the_plant() -> None:
    frame, truth = recording("partial", 120.0, 2)
    per_percent = MACHINE.drag_per_percent_nm
    assert per_percent is not None
    estimates = run(blocks_of(frame))
    known = [e for e in estimates if e.drag_torque_nm is not None]
    true = np.array([truth[round(e.time_s * RATE_HZ)] * per_percent for e in known])
    low = np.array([e.drag_torque_nm.low for e in known if e.drag_torque_nm])
    high = np.array([e.drag_torque_nm.high for e in known if e.drag_torque_nm])
    assert np.mean((low <= true) & (true <= high)) >= 0.93
    assert np.mean(high - low) < 0.2 * per_percent * 6.85


def test_a_sudden_loss_is_seen_within_seconds_of_motion() -> None:
    frame, _ = recording("sudden", 60.0, 3)
    estimates = run(blocks_of(frame))
    low_since = min(e.time_s for e in estimates if (e.preload_percent or 10.0) < 2.5)
    assert 30.0 <= low_since <= 33.0
    settled = [e.preload_percent for e in estimates if e.time_s > 40.0]
    assert max(p for p in settled if p is not None) < 1.0


@pytest.mark.parametrize("interval_s", [0.02, 0.1])
def test_a_loss_within_half_a_minute_stays_inside_the_interval(interval_s: float) -> None:
    frame, truth = recording("fast", 50.0, 12)
    _, covered = errors(run(blocks_of(frame, interval_s)), truth)
    assert covered >= 0.93


def test_the_result_does_not_depend_on_the_interval() -> None:
    frame, truth = recording("gradual", 60.0, 4)
    reference, _ = errors(run(blocks_of(frame)), truth)
    error, covered = errors(run(blocks_of(frame, 0.05)), truth)
    assert np.mean(np.abs(error)) < np.mean(np.abs(reference)) + 0.1
    assert covered >= 0.93


def changed(frame: SampleFrame, **channels: Floats) -> SampleFrame:
    return SampleFrame(frame.time_s, dict(frame.channels) | channels)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda frame: changed(frame, torque_command_nm=-frame.channels[TORQUE]),
        lambda frame: changed(frame, torque_command_nm=4.0 * frame.channels[TORQUE]),
        lambda frame: changed(frame, torque_command_nm=np.full(len(frame), np.nan)),
        lambda frame: changed(frame, torque_command_nm=np.zeros(len(frame))),
    ],
    ids=["swapped sign", "wrong torque constant", "no torque", "dead torque"],
)
def test_a_model_that_does_not_fit_gives_a_reason_instead_of_a_number(
    spoil: Callable[[SampleFrame], SampleFrame],
) -> None:
    frame, _ = recording("healthy", 30.0, 10)
    estimates = run(blocks_of(spoil(frame)))
    late = [e for e in estimates if e.time_s > 10.0]
    assert all(e.preload_percent is None for e in late)
    assert all(e.reasons for e in late)


@pytest.mark.parametrize("row", [19_999, 20_000, 20_001, 20_050])
def test_one_wild_angle_does_not_spoil_what_follows(row: int) -> None:
    frame, truth = recording("healthy", 40.0, 13)
    angle = frame.channels[ANGLE].copy()
    angle[row] += 4.0
    estimates = run(blocks_of(changed(frame, motor_angle_rad=angle)))
    late = [e for e in estimates if e.time_s > 22.0]
    assert {e.status for e in late} == {EstimateStatus.ESTIMATED}
    _, covered = errors(late, truth)
    assert covered >= 0.93


@pytest.mark.parametrize("channel", [ANGLE, TORQUE])
def test_a_channel_that_is_stuck_throughout_is_a_fault_not_standstill(channel: str) -> None:
    frame, _ = recording("healthy", 40.0, 13)
    stuck = changed(frame, **{channel: np.full(len(frame), 0.1)})
    late = [e.status for e in run(blocks_of(stuck)) if e.time_s > 10.0]
    assert late.count(EstimateStatus.INVALID) > 0.9 * len(late)


def test_without_a_load_rating_there_is_drag_but_no_percent() -> None:
    axis = MACHINE.axis.model_copy(update={"dynamic_load_rating_n": None})
    unrated = MACHINE.model_copy(update={"axis": axis})
    last = run(blocks_of(recording("healthy", 20.0, 11)[0]), unrated)[-1]
    assert last.status is EstimateStatus.ESTIMATED
    assert last.preload_percent is None
    assert last.mode_probability == {}
    assert "axis.dynamic_load_rating_n is unknown" in last.reasons[0]
    assert last.drag_torque_nm is not None
    assert last.drag_torque_nm.low < 0.146 < last.drag_torque_nm.high


EMPS = Path(__file__).parents[3].parent / "shared" / "data" / "emps"


@pytest.mark.skipif(not EMPS.is_dir(), reason="the EMPS recordings are not there")
@pytest.mark.parametrize(
    ("file", "force_n"), [("emps_estimation.csv", 20.3935), ("emps_validation_pulses.csv", 20.39)]
)
def test_the_real_axis_has_its_published_drag(file: str, force_n: float) -> None:
    """Janot, Gautier, Brunot (2019): Coulomb friction 20.39 N at the table."""
    from edge_service.recordings.reader import open_trace

    machine = load_machine(Path(__file__).parents[3] / "deploy" / "emps.toml")
    ratio = machine.transmission_ratio_m_per_rad
    downsampler = Downsampler(DownsampleSettings(), ratio)
    with open_trace(EMPS / file, machine.columns) as frames:
        blocks = [block for frame in frames for block in downsampler.push(frame)]
    late = [e for e in run(blocks, machine) if e.time_s > 5.0]
    assert {e.status for e in late} == {EstimateStatus.ESTIMATED}
    assert {e.preload_percent for e in late} == {None}
    drags = np.array([e.drag_torque_nm.value for e in late if e.drag_torque_nm]) / ratio
    assert np.mean(drags) == pytest.approx(force_n, rel=0.05)
    inside = [e.drag_torque_nm.low <= force_n * ratio <= e.drag_torque_nm.high for e in late]  # type: ignore[union-attr]
    assert np.mean(inside) >= 0.95
