"""Behaviour of every preload estimator; one enrols by its line in the registry."""

import json
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from edge_service.downsample.statistics import absent_block
from edge_service.estimate.interface import (
    AUTO,
    ESTIMATORS,
    PreloadEstimator,
    UnsuitableMachineError,
    make_estimator,
)
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import Fault, FeatureBlock, Phase
from edge_service.messages.samples import ANGLE, TORQUE, SampleFrame
from edge_service.messages.topics import FEAT
from edge_service.models.compiled import cache_folder, compiled, is_private
from edge_service.models.machine import Machine
from edge_service.nodes.estimated_axis import DAMAGED
from tests.programs import printed

from ..bench.estimator.axis import OwnAxis, downsampled

SECONDS = 15.0
STATES = Path(__file__).parent / "states"
LONGEST_REST_S = 10.0
NUMBERS = ("preload_percent", "low", "high", "preload_n", "drag_torque_nm", "stiffness_n_per_m")
METHODS = pytest.mark.parametrize("method", ESTIMATORS)
ENCODERS = pytest.mark.parametrize("one_encoder", [False, True])
KERNEL = """
import numba
from edge_service.models.screw.nut_law import nut_stiffness
assert nut_stiffness(1.6e8, 10.0) == nut_stiffness.py_func(1.6e8, 10.0)
print(numba.config.CACHE_DIR, sum(nut_stiffness.stats.cache_hits.values()))
"""


@cache
def axis(one_encoder: bool) -> OwnAxis:
    return OwnAxis(1, one_encoder=one_encoder)


@cache
def machine(one_encoder: bool = False) -> Machine:
    return axis(one_encoder).commissioned()


@cache
def frames(one_encoder: bool = False) -> tuple[SampleFrame, ...]:
    percent = np.full(round(1000 * SECONDS), axis(one_encoder).fresh_percent)
    return tuple(axis(one_encoder).frames("production", percent, 6))


@cache
def blocks(one_encoder: bool = False) -> tuple[FeatureBlock, ...]:
    return tuple(downsampled(frames(one_encoder), machine(one_encoder)))


def made(method: str, one_encoder: bool = False) -> PreloadEstimator:
    return make_estimator(method, machine(one_encoder))


def fed(estimator: PreloadEstimator, block: FeatureBlock) -> PreloadEstimate:
    estimator.update(block)
    return estimator.estimate()


def run(estimator: PreloadEstimator, over: Iterable[FeatureBlock]) -> list[str]:
    return [fed(estimator, block).model_dump_json() for block in over]


def stored(estimator: PreloadEstimator) -> str:
    return json.dumps(estimator.snapshot(), allow_nan=False)


def later(over: Sequence[FeatureBlock], by_s: float) -> Iterator[FeatureBlock]:
    for block in over:
        yield replace(block, time_s=block.time_s + by_s)


def assert_sound(answer: PreloadEstimate) -> None:
    """Numbers only with the status `estimated`, within their intervals; reasons without them."""
    if answer.status is not EstimateStatus.ESTIMATED:
        assert all(getattr(answer, name) is None for name in NUMBERS)
        assert answer.reasons
        return
    assert answer.drag_torque_nm is not None
    for interval in (answer.drag_torque_nm, answer.stiffness_n_per_m):
        if interval is not None:
            assert interval.low <= interval.value <= interval.high
    if answer.preload_percent is not None:
        assert answer.low is not None
        assert answer.high is not None
        assert 0.0 <= answer.low <= answer.preload_percent <= answer.high
        assert math.fsum(answer.mode_probability.values()) == pytest.approx(1.0)
    assert all(0.0 <= each <= 1.0 for each in answer.mode_probability.values())
    assert all(0.0 <= each <= 1.0 for each in answer.fault_probability.values())


@METHODS
@ENCODERS
def test_numbers_stand_with_the_status_estimated_alone_and_within_their_intervals(
    method: str, one_encoder: bool
) -> None:
    estimator = made(method, one_encoder)
    answers = [estimator.estimate()]
    answers += [fed(estimator, block) for block in blocks(one_encoder)]
    for answer in answers:
        assert_sound(answer)
    assert answers[0].status is EstimateStatus.UNESTIMATED
    assert answers[-1].status is EstimateStatus.ESTIMATED
    assert answers[-1].preload_percent is not None


@METHODS
@ENCODERS
@pytest.mark.parametrize("share", [0.0, 0.07, 0.5])
def test_a_restored_estimator_gives_identical_bytes(
    method: str, one_encoder: bool, share: float
) -> None:
    count = round(share * len(blocks(one_encoder)))
    first, second = made(method, one_encoder), made(method, one_encoder)
    run(first, blocks(one_encoder)[:count])
    kept = stored(first)
    run(second, blocks(one_encoder)[:5])
    second.restore(json.loads(kept))
    assert stored(second) == kept
    rest = blocks(one_encoder)[count:]
    assert run(first, rest) == run(second, rest)
    assert stored(first) == stored(second)


@METHODS
def test_a_snapshot_is_not_changed_by_what_comes_after_it(method: str) -> None:
    estimator = made(method)
    run(estimator, blocks()[:40])
    snapshot = estimator.snapshot()
    before = json.dumps(snapshot)
    run(estimator, blocks()[40:80])
    assert json.dumps(snapshot) == before


@METHODS
def test_a_snapshot_that_lacks_something_is_refused(method: str) -> None:
    estimator = made(method)
    run(estimator, blocks()[:40])
    whole = estimator.snapshot()
    for name in whole:
        with pytest.raises(DAMAGED):
            made(method).restore({key: value for key, value in whole.items() if key != name})


def spoilt(block: FeatureBlock) -> Iterator[FeatureBlock]:
    """The interval without one channel or all, with each fault, and not there at all."""
    unknown = dict.fromkeys(("table_start_m", "table_end_m", "table_mean_m"), math.nan)
    yield replace(block, fault=block.fault | Fault.NO_TABLE, **unknown)
    yield replace(block, temperature_c=math.nan, external_force_n=math.nan)
    yield replace(block, accelerating=Phase(), cruising=Phase(), braking=Phase())
    for fault in Fault:
        yield replace(block, fault=fault)
    for fault in (Fault.NO_POSITION, Fault.NO_TORQUE):
        yield absent_block(round(block.time_s / block.duration_s) - 1, block.duration_s, fault)


@METHODS
@ENCODERS
def test_missing_and_faulty_data_never_raise(method: str, one_encoder: bool) -> None:
    estimator = made(method, one_encoder)
    for block in blocks(one_encoder)[:50]:
        for worse in spoilt(block):
            assert_sound(fed(estimator, worse))
        assert_sound(fed(estimator, block))
        json.loads(stored(estimator))


@METHODS
def test_reset_forgets_everything(method: str) -> None:
    used, new = made(method), made(method)
    run(used, blocks()[50:100])
    used.reset()
    assert stored(used) == stored(new)
    assert run(used, blocks()[:60]) == run(new, blocks()[:60])


@METHODS
@ENCODERS
def test_live_is_replay(method: str, one_encoder: bool) -> None:
    """Samples in any pieces, blocks over the wire, beside another estimator: the same bytes."""
    replayed = run(made(method, one_encoder), blocks(one_encoder))
    whole = frames(one_encoder)
    time_s = np.concatenate([frame.time_s for frame in whole])
    channels = {
        name: np.concatenate([frame.channels[name] for frame in whole])
        for name in whole[0].channels
    }
    edges = [*range(0, len(time_s), 37), len(time_s)]
    pieces = [
        SampleFrame(time_s[a:b], {name: values[a:b] for name, values in channels.items()})
        for a, b in pairwise(edges)
    ]
    header = Header(0, 0, 0, 0)
    live, other = made(method, one_encoder), made(method, one_encoder)
    said = []
    for block in downsampled(pieces, machine(one_encoder)):
        _, _, heard = FEAT.decode(FEAT.encode("X", header, block))
        said.append(fed(live, heard).model_dump_json())
        other.update(replace(block, torque_mean_nm=2.0 * block.torque_mean_nm))
    assert said == replayed


@METHODS
@pytest.mark.parametrize("gap_s", [0.3, 5.0, 60.0, 86_400.0])
def test_a_gap_is_bridged(method: str, gap_s: float) -> None:
    estimator = made(method)
    run(estimator, blocks()[:100])
    for block in later(blocks()[100:], gap_s):
        assert_sound(fed(estimator, block))
    assert estimator.estimate().status is EstimateStatus.ESTIMATED


@METHODS
def test_no_number_outlives_an_interruption_or_a_long_rest(method: str) -> None:
    estimator = made(method)
    run(estimator, blocks()[:100])
    assert estimator.estimate().preload_percent is not None
    estimator.interrupt()
    assert_sound(estimator.estimate())
    assert estimator.estimate().preload_percent is None
    run(estimator, blocks()[100:])
    assert estimator.estimate().preload_percent is not None
    last = blocks()[-1]
    at_rest = replace(
        last,
        angle_start_rad=last.angle_end_rad,
        angle_mean_rad=last.angle_end_rad,
        **dict.fromkeys(("speed_start_rad_s", "speed_end_rad_s", "speed_min_rad_s"), 0.0),
        **dict.fromkeys(("speed_max_rad_s", "direction_mean", "direction_lever"), 0.0),
        **dict.fromkeys(("moving_fraction", "steady_direction"), 0.0),
        accelerating=Phase(),
        cruising=Phase(),
        braking=Phase(),
    )
    resting = [replace(at_rest, time_s=last.time_s + 0.1 * k) for k in range(1, 110)]
    for block in resting:
        answer = fed(estimator, block)
        rested_s = block.time_s - last.time_s
        assert (answer.preload_percent is None) or rested_s <= LONGEST_REST_S + 0.2
    assert estimator.estimate().preload_percent is None


@METHODS
def test_no_number_outlives_a_new_clock(method: str) -> None:
    estimator = made(method)
    run(estimator, blocks())
    assert estimator.estimate().preload_percent is not None
    noise = np.random.default_rng(15).standard_normal(8000)
    last = {name: np.full(8000, values[-1]) for name, values in frames()[-1].channels.items()}
    still = SampleFrame(
        np.arange(8000) * 1e-3, {**last, ANGLE: last[ANGLE] + 5e-6 * noise, TORQUE: 0.02 * noise}
    )
    anew = downsampled([*frames(), still], machine())[len(blocks()) + 1 :]
    assert len(anew) > 70
    for block in anew:
        assert fed(estimator, block).status is EstimateStatus.INSUFFICIENT_EXCITATION


@METHODS
def test_a_stop_on_another_clock_is_bridged(method: str) -> None:
    estimator = made(method)
    run(estimator, blocks()[:100])
    estimator.resume(3600.0)
    assert estimator.estimate().preload_percent is None
    for block in blocks():
        assert_sound(fed(estimator, block))
    assert estimator.estimate().status is EstimateStatus.ESTIMATED


def test_auto_takes_the_first_that_suits_the_machine() -> None:
    nominal = axis(one_encoder=False).nominal()
    kinds = {
        (method, file is nominal): type(make_estimator(method, file))
        for method, file in product([AUTO, "kf-imm"], [nominal, machine()])
    }
    assert kinds[AUTO, True] is kinds["kf-imm", True] is kinds["kf-imm", False]
    assert kinds[AUTO, False] is type(made("mixture"))
    with pytest.raises(UnsuitableMachineError, match="edge-service commission"):
        make_estimator("mixture", nominal)


@METHODS
def test_a_state_that_an_earlier_version_has_stored_goes_on(method: str) -> None:
    kept = (STATES / f"{method}.json").read_text("utf-8").strip()
    estimator = made(method, one_encoder=True)
    estimator.restore(json.loads(kept))
    assert stored(estimator) == kept
    assert estimator.estimate().status is EstimateStatus.ESTIMATED


def test_division_by_zero_is_as_in_numpy() -> None:
    def inverse(x: float) -> float:
        return 1.0 / x

    assert compiled(inverse)(0.0) == float("inf")


def test_machine_code_is_never_kept_where_others_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = tmp_path / "shared"
    for mode, private in ((0o700, True), (0o755, True), (0o775, False), (0o1777, False)):
        shared.mkdir(exist_ok=True)
        shared.chmod(mode)
        assert is_private(shared) is private
    monkeypatch.setenv("CACHE_DIRECTORY", str(shared / "mine"))
    assert cache_folder() is None


def test_a_second_process_compiles_nothing(tmp_path: Path) -> None:
    def hits() -> list[str]:
        return printed(sys.executable, "-c", KERNEL, NUMBA_CACHE_DIR=str(tmp_path)).split()

    assert [hits(), hits()] == [[str(tmp_path), "0"], [str(tmp_path), "1"]]
