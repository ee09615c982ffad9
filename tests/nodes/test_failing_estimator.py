"""An estimator that raises costs its axis alone the number; the thesis's stands beside it."""

import asyncio
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import pytest

from edge_service.config import DEFAULT_MACHINE, EstimatorConfig, load_machine
from edge_service.estimate.interface import PreloadEstimator
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus, ImmEstimate, PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.health import ComponentStatus
from edge_service.messages.topics import FEAT, IMM, PRELOAD, STATUS
from edge_service.nodes import estimate_node, stages
from edge_service.nodes.estimated_axis import MOST_FAILURES, SOUND_PERIOD, EstimatedAxis
from edge_service.nodes.stages import make_downsampler
from edge_service.offline.estimate import OfflineEstimate

from ..messages.examples import PAYLOADS
from .conftest import (
    PATIENCE_S,
    Running,
    config_of,
    once,
    production,
    reported,
    running,
    served,
    two_axes,
)

PERIOD_S = 0.1
Raises = Callable[[int, int], bool]
"""Number of an interval, and of those in the state -> the estimator raises."""


def interval(end_s: float) -> FeatureBlock:
    return replace(PAYLOADS["feat"], time_s=end_s, duration_s=PERIOD_S)


class Stub:
    """An estimator that counts what it has taken, and says how many as its number."""

    def __init__(self, raises: Raises) -> None:
        self._raises = raises
        self._taken = 0
        self._half_made = False

    def update(self, block: FeatureBlock) -> None:
        self._half_made = True
        if self._raises(round(block.time_s / PERIOD_S), self._taken):
            raise ZeroDivisionError
        self._taken += 1
        self._half_made = False

    def estimate(self) -> PreloadEstimate:
        number = -1.0 if self._half_made else float(self._taken)
        status = EstimateStatus.ESTIMATED
        return PreloadEstimate(time_s=0.0, status=status, preload_percent=number)

    def interrupt(self) -> None:
        pass

    def resume(self, stopped_s: float) -> None:
        pass

    def reset(self) -> None:
        self._taken = 0

    def snapshot(self) -> dict[str, Any]:
        return {"taken": -1 if self._half_made else self._taken}

    def restore(self, snapshot: dict[str, Any]) -> None:
        self._taken = snapshot["taken"]


class Scene:
    """An axis that is fed ten intervals a second, on a clock of its own."""

    def __init__(self, raises: Raises, make: Callable[[Raises], PreloadEstimator] = Stub) -> None:
        self.made = 0
        self.errors: list[Exception] = []
        self.resets: list[str] = []
        self.now_s = 0.0
        self._number = 0

        def made() -> PreloadEstimator:
            self.made += 1
            return make(raises)

        self.axis = EstimatedAxis("X", made, self._note, self.resets.append, lambda: self.now_s)

    def _note(self, error: Exception) -> str:
        self.errors.append(error)
        return "the estimator fails"

    def feed(self, count: int) -> list[float | None]:
        """The numbers after so many intervals more; None where there was none."""
        return [self._take() for _ in range(count)]

    def _take(self) -> float | None:
        self._number += 1
        self.now_s += PERIOD_S
        time_s = self._number * PERIOD_S
        header = Header(self._number, 1, round(1e9 * time_s), 0)
        estimate = self.axis.take(header, interval(time_s))
        has_number = estimate.status is EstimateStatus.ESTIMATED
        assert has_number is (estimate.preload_percent is not None)
        assert has_number is not any(e.startswith("estimator_failed") for e in estimate.reasons)
        assert has_number is not bool(self.axis.problem)
        return estimate.preload_percent


def test_one_that_always_raises_gives_no_number_and_is_tried_ever_less_often() -> None:
    scene = Scene(lambda _number, _taken: True)
    assert set(scene.feed(6000)) == {None}
    assert 10 <= len(scene.errors) <= 30  # in ten minutes
    assert scene.made <= len(scene.errors) + 1
    assert scene.resets == []  # there is no state to blame
    assert scene.axis.to_keep() is None


def test_one_interval_that_raises_costs_a_second_of_the_state() -> None:
    scene = Scene(lambda number, _taken: number == 101)
    before, after = scene.feed(100), scene.feed(50)
    assert before[-1] == 100.0
    numbers = [each for each in after if each is not None]
    assert after[0] is None and after.index(numbers[0]) <= 6
    assert numbers[0] > 100.0 - SOUND_PERIOD
    assert (len(scene.errors), scene.resets) == (1, [])


@pytest.mark.parametrize("worst", [90, 95, 99])
def test_a_state_that_raises_again_and_again_is_given_up(worst: int) -> None:
    scene = Scene(lambda _number, taken: taken >= worst)
    scene.feed(worst)
    scene.feed(75)
    assert (len(scene.resets), len(scene.errors)) == (1, MOST_FAILURES)
    numbers = [each for each in scene.feed(20) if each is not None]
    assert numbers == sorted(numbers) and numbers[-1] < worst  # a fresh one goes on


def test_a_part_that_is_replaced_meanwhile_is_forgotten() -> None:
    scene = Scene(lambda number, _taken: number >= 51 and number < 56)
    scene.feed(52)
    assert scene.axis.problem
    scene.axis.forget()
    assert not scene.axis.problem
    numbers = [each for each in scene.feed(100) if each is not None]
    assert numbers[0] < 10.0


class Unkept(Stub):
    """A stub of which nothing can be kept."""

    def snapshot(self) -> dict[str, Any]:
        raise RuntimeError("no state")


class Unrestored(Stub):
    """A stub that no state can be given back."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        raise RuntimeError("no way back")


@pytest.mark.parametrize("make", [Unkept, Unrestored])
def test_a_state_that_cannot_be_taken_or_given_back_ends_nothing(make: type[Stub]) -> None:
    scene = Scene(lambda number, _taken: number == 33, make)
    scene.feed(2000)
    scene.axis.to_keep()
    assert scene.errors
    assert scene.feed(2000).count(None) < 2000


@pytest.mark.parametrize("seed", range(30))
def test_whatever_raises_when_no_number_comes_from_a_state_left_half_made(seed: int) -> None:
    dice = random.Random(seed)
    share, bad_state = dice.choice((0.0, 0.01, 0.3)), dice.choice((5, 50, 10**9))
    bad = {number for number in range(3000) if dice.random() < share}
    scene = Scene(lambda number, taken: number in bad or taken >= bad_state)
    numbers = [each for each in scene.feed(3000) if each is not None]
    assert all(0.0 < each <= bad_state for each in numbers)
    assert scene.made <= len(scene.errors) + 1
    kept = scene.axis.to_keep()
    assert kept is None or kept.snapshot["taken"] > 0


async def test_an_axis_that_fails_says_so_and_the_other_is_undisturbed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    config = two_axes()
    monkeypatch.setattr(stages, "warm_up", lambda *_args: None)
    names = iter(("X", "Y"))

    def make(*_args: Any) -> PreloadEstimator:
        name = next(names, "X")  # after the start only the one that fails is made again
        return Stub(lambda _number, _taken: name == "X")

    monkeypatch.setattr(estimate_node, "make_estimator", make)
    async with running(config, ("estimate",)) as service:
        keys, bus = config.keys, service.bus
        reports = bus.subscribe(keys.all_components(STATUS), STATUS, depth=4096)
        preloads = bus.subscribe(keys.all_axes(PRELOAD), PRELOAD, depth=4096)
        sends = {name: bus.publisher(keys.key(name, FEAT), FEAT, name) for name in ("X", "Y")}
        async with asyncio.timeout(PATIENCE_S):
            await reported(service, "estimate", ComponentStatus.OK, "Y")
            answers = aiter(preloads)
            for number in range(1, 21):
                for send in sends.values():
                    block = interval(number * PERIOD_S)
                    send.publish(block, round(1e9 * block.time_s))
                told = {}
                while len(told) < 2:
                    name, _, estimate = await anext(answers)
                    told[name] = estimate
                assert told["X"].preload_percent is None
                assert told["X"].status is EstimateStatus.UNESTIMATED
                assert told["Y"].preload_percent == float(number)
            broken = await reported(service, "estimate", ComponentStatus.RECOVERABLE_ERROR, "X")
            assert "the estimator fails" in broken.reason
            assert broken.readings["tasks_down"] == 1.0
            await reported(service, "estimate", ComponentStatus.OK, "Y")
        reports.close()
        degraded = {
            (each.component, each.axis)
            async for _, _, each in reports
            if each.status is ComponentStatus.RECOVERABLE_ERROR
        }
        assert degraded <= {("estimate", "X")}


COMMISSIONED = DEFAULT_MACHINE.with_name("commissioned.toml")
MACHINE = load_machine(COMMISSIONED)
FRAME = production(MACHINE, 5.0, 20_000)


async def opinions(service: Running, blocks: list[FeatureBlock]) -> list[ImmEstimate]:
    keys, bus, heard = service.context.config.keys, service.bus, []
    answers = bus.subscribe(keys.key("X", IMM), IMM, depth=4096)
    send = bus.publisher(keys.key("X", FEAT), FEAT, "X")
    async with asyncio.timeout(PATIENCE_S):
        await reported(service, "estimate", ComponentStatus.OK, "X")
        said = aiter(answers)
        for block in blocks:
            send.publish(block, round(1e9 * block.time_s))
            heard.append((await anext(said))[2])
    return heard


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
async def test_it_has_the_numbers_of_the_command_on_the_same_blocks(
    engine: Literal["compiled", "filterpy"],
) -> None:
    offline = OfflineEstimate(MACHINE, EstimatorConfig(method="kf-imm"))
    wanted = list(offline.estimates([FRAME]))
    blocks = make_downsampler(MACHINE).push(FRAME)
    config = config_of("simulated", {}, COMMISSIONED, estimator=EstimatorConfig(engine=engine))
    async with running(config, ("estimate",)) as service:
        heard = await opinions(service, blocks)
    assert [each.status for each in heard] == [each.status for each in wanted]
    assert {each.engine for each in heard} == {engine}
    pairs = [each for each in zip(heard, wanted, strict=True) if each[1].low is not None]
    assert len(pairs) > 100
    for name in ("mode_probability", "preload_percent", "low", "high"):
        for ours, theirs in pairs:
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=0, abs=1e-9)


async def test_its_errors_are_counted_and_touch_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimate_node, "make_beside", lambda *_: Stub(lambda *_: True))
    config = config_of("simulated", {}, COMMISSIONED)
    async with running(config, ("estimate",)) as service:
        answers = service.bus.subscribe(config.keys.key("X", PRELOAD), PRELOAD, depth=4096)
        heard = await opinions(service, make_downsampler(MACHINE).push(FRAME))
        part = await reported(service, "estimate", ComponentStatus.OK, "X")
        answers.close()
        last = [estimate async for _, _, estimate in answers][-1]
    assert {each.status for each in heard} == {EstimateStatus.UNESTIMATED}
    assert part.counters["imm_failures"] >= 1
    assert (last.status, last.method) == (EstimateStatus.ESTIMATED, "mixture")


async def test_where_it_is_the_answer_it_runs_once_and_the_page_tells_it() -> None:
    config = config_of("simulated", {"scenario": "healthy"})
    async with served(config) as (_, client):
        told = await once(client, "axes/X/imm", lambda said: said["low"] is not None and said)
        assert told["low"] < told["preload_percent"] < told["high"]
        assert list(told["mode_probability"]) == ["10", "7.5", "5", "2.5", "0"]
        assert sum(told["mode_probability"].values()) == pytest.approx(1.0)
        answer = (await client.get("api/v1/axes/X/preload")).json()
        assert answer["method"] == "kf-imm"
        metrics = (await client.get("metrics")).text
        assert 'edge_service_imm_preload_rating_ratio{axis="X",bound="low"}' in metrics
