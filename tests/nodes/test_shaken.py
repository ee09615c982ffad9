"""An axis with one encoder that is shaken while the service runs: its test is read and kept."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import tomlkit

from edge_service.config_tables import StoreConfig
from edge_service.recordings.writer import TraceWriter

from ..estimate.tested_axis import FRESH_PERCENT, as_it_is, machine_of, on_a_day
from ..fingerprint.shaken_axis import START_M, STEP_S, SWEEP_S, Array, Axis, driven, sweeps
from .conftest import config_of, served, until

SPEED, FEED_M_S = 10.0, 0.02
AXIS = Axis(share=0.3, guide_n=30.0)
WORN = replace(AXIS, preload=0.2)


def moves(seconds: float) -> Array:
    """Speed in each step of rapids to and fro."""
    speed = np.repeat([0.0, 0.2, 0.2, 0.0, -0.2, -0.2] * round(seconds / 6.0), round(1 / STEP_S))
    return np.convolve(speed, np.full(8000, 1.0 / 8000.0), mode="same")


def source(folder: Path, axis: Axis, *speeds: Array) -> dict[str, Any]:
    """Settings of a driver that plays what an axis does."""
    path, frame = folder / f"{len(speeds)}.csv", driven(axis, np.concatenate(speeds), 3)
    with TraceWriter(path, tuple(frame.channels)) as writer:
        writer.write(frame)
    return {"path": str(path), "speed": SPEED}


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("machine") / "x.toml"
    random = np.random.default_rng(1)
    place_rad = (START_M + 0.5 * FEED_M_S * SWEEP_S) / AXIS.radius_m
    days = [as_it_is(on_a_day(AXIS, random)) for _ in range(3)]
    tests = [each.model_copy(update={"place_rad": place_rad}) for each in days]
    commissioned = machine_of(AXIS, tests)
    path.write_text(tomlkit.dumps(commissioned.model_dump(mode="json", exclude_none=True)))
    return path


async def told(client: httpx.AsyncClient) -> Any:
    """What was told of the first test, once that is read."""

    async def items() -> Any:
        return (await client.get("api/v1/log?axis=X&kind=tested")).json()["items"]

    (event,) = await until(items)
    return event


async def estimated(client: httpx.AsyncClient, *, due: bool) -> Any:
    """The next answer with a number, and with or without the word that a test is due."""

    async def answer() -> Any:
        now = (await client.get("api/v1/axes/X/preload")).json()
        is_due = any(reason.startswith("test_due: no test yet") for reason in now["reasons"])
        return now if now["status"] == "estimated" and is_due == due else None

    return await until(answer)


@pytest.mark.slow
async def test_a_test_that_the_service_sees_tells_the_preload_and_outlives_a_restart(
    machine: Path, tmp_path: Path
) -> None:
    store = {"store": StoreConfig(folder=tmp_path / "state")}
    settings = source(tmp_path, WORN, moves(6.0), sweeps(1000.0), moves(150.0))
    async with served(config_of("replay", settings, machine, **store)) as (_, client):
        await estimated(client, due=True)
        event = await told(client)
        assert event["level"] == "NORMAL"
        assert event["code"] == "tested"
        assert event["values"]["low"] <= 20.0 <= event["values"]["high"] < 80.0
        after = await estimated(client, due=False)
        assert after["low"] <= 0.2 * FRESH_PERCENT <= after["high"] < 0.8 * FRESH_PERCENT
    settings = source(tmp_path, WORN, moves(60.0))
    async with served(config_of("replay", settings, machine, **store)) as (_, client):
        again = await estimated(client, due=False)
        assert again["high"] < 0.8 * FRESH_PERCENT


@pytest.mark.slow
async def test_a_test_that_cannot_be_used_is_told_with_its_reason(
    machine: Path, tmp_path: Path
) -> None:
    settings = source(tmp_path, AXIS, sweeps(1000.0, speed_share=1.5), moves(150.0))
    async with served(config_of("replay", settings, machine)) as (_, client):
        event = await told(client)
        assert event["level"] == "WARNING"
        assert "the axis reversed or stood while it was shaken" in event["text"]
        await estimated(client, due=True)
