"""The thesis' estimator beside the answer: its numbers, its two engines, and its errors."""

import asyncio
from typing import Literal

import pytest

from edge_service.config import DEFAULT_MACHINE, EstimatorConfig, load_machine
from edge_service.messages.estimate import EstimateStatus, ImmEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.health import ComponentStatus
from edge_service.messages.topics import FEAT, IMM, PRELOAD
from edge_service.nodes import estimate_node
from edge_service.nodes.stages import make_downsampler
from edge_service.offline.estimate import OfflineEstimate

from .conftest import PATIENCE_S, Running, config_of, once, production, reported, running, served
from .test_failing_estimator import Stub

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
