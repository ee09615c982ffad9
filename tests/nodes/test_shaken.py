"""An axis with one encoder that is shaken while the service runs: its test is read and kept."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import tomlkit

from edge_service.config_tables import StoreConfig
from edge_service.nodes.record_node import Shaking
from edge_service.nodes.stages import make_downsampler
from edge_service.recordings.writer import TraceWriter

from ..estimate.test_one_encoder import AXIS, FRESH_PERCENT, MACHINE
from ..fingerprint.shaken_axis import FEED_M_S, STEP_S, SWEEP_S, Array, Axis, driven, smooth, sweeps
from .conftest import config_of, once, served

TO_AND_FRO = [0.0, 0.2, 0.2, 0.0, -0.2, -0.2]
WORN = replace(AXIS, preload=0.2)


def source(folder: Path, axis: Axis, *speeds: Array) -> dict[str, Any]:
    """Settings of a driver that plays what an axis does."""
    path, frame = folder / f"{len(speeds)}.csv", driven(axis, np.concatenate(speeds), 3)
    with TraceWriter(path, tuple(frame.channels)) as writer:
        writer.write(frame)
    return {"path": str(path), "speed": 10.0}


@pytest.mark.parametrize(
    ("speeds", "seen"),
    [
        ((smooth(TO_AND_FRO * 2), sweeps(), smooth(TO_AND_FRO * 2)), True),
        ((sweeps(feed_m_s=0.0), np.zeros(round(13.0 / STEP_S))), True),
        ((smooth(TO_AND_FRO * 10),), False),
        ((0.02 * np.sin(np.arange(0.0, 300.0, 10.0 * STEP_S)), smooth(TO_AND_FRO * 2)), False),
    ],
    ids=["a test", "without a feed", "production", "a small circle"],
)
def test_only_a_test_is_seen_and_cut_out_whole(speeds: tuple[Array, ...], seen: bool) -> None:
    frame = driven(AXIS, np.concatenate(speeds), 1)
    shaking = Shaking(FEED_M_S / AXIS.radius_m, AXIS.nut_nm + AXIS.guide_n * AXIS.radius_m)
    shaking.samples.push(frame)
    found = [cut for block in make_downsampler(MACHINE).push(frame) if (cut := shaking.over(block))]
    assert len(found) == seen
    if seen:
        duration_s = found[0][-1].time_s[-1] - found[0][0].time_s[0]
        assert 2.0 * SWEEP_S < duration_s < 2.0 * SWEEP_S + 20.0


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("machine") / "x.toml"
    path.write_text(tomlkit.dumps(MACHINE.model_dump(mode="json", exclude_none=True)))
    return path


async def told(client: httpx.AsyncClient) -> Any:
    """Event of the first test, once that is read."""
    (event,) = await once(client, "log?axis=X&kind=tested", lambda log: log["items"])
    return event


async def estimated(client: httpx.AsyncClient, *, due: bool) -> Any:
    """The next answer with a number, and with or without the word that a test is due."""

    def probe(now: Any) -> Any:
        is_due = any(reason.startswith("test_due: no test yet") for reason in now["reasons"])
        return now["status"] == "estimated" and is_due == due and now

    return await once(client, "axes/X/preload", probe)


@pytest.mark.slow
async def test_a_test_that_the_service_sees_tells_the_preload_and_outlives_a_restart(
    machine: Path, tmp_path: Path
) -> None:
    store = {"store": StoreConfig(folder=tmp_path / "state")}
    settings = source(tmp_path, WORN, smooth(TO_AND_FRO * 1), sweeps(), smooth(TO_AND_FRO * 25))
    async with served(config_of("replay", settings, machine, **store)) as (_, client):
        await estimated(client, due=True)
        event = await told(client)
        assert (event["level"], event["code"]) == ("NORMAL", "tested")
        assert event["values"]["low"] <= 20.0 <= event["values"]["high"] < 80.0
        after = await estimated(client, due=False)
        assert after["low"] <= 0.2 * FRESH_PERCENT <= after["high"] < 0.8 * FRESH_PERCENT
    settings = source(tmp_path, WORN, smooth(TO_AND_FRO * 10))
    async with served(config_of("replay", settings, machine, **store)) as (_, client):
        again = await estimated(client, due=False)
        assert again["high"] < 0.8 * FRESH_PERCENT


@pytest.mark.slow
async def test_a_test_that_cannot_be_used_is_told_with_its_reason(
    machine: Path, tmp_path: Path
) -> None:
    settings = source(tmp_path, AXIS, sweeps(speed_share=1.5), smooth(TO_AND_FRO * 25))
    async with served(config_of("replay", settings, machine)) as (_, client):
        event = await told(client)
        assert event["level"] == "WARNING"
        assert "the axis reversed or stood while it was shaken" in event["text"]
        await estimated(client, due=True)
