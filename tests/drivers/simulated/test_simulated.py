import asyncio
import tomllib
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest

from drivers.base import DriverContext, DriverMisconfiguredError
from drivers.simulated import SimulatedConfig, SimulatedDriver
from edge_service.messages.samples import CHANNELS, EXTERNAL_FORCE, TORQUE, SampleFrame
from edge_service.models.machine import Machine

BENCH = Path(__file__).parents[3] / "deploy" / "machine.toml"


def context() -> DriverContext:
    return DriverContext("X", Machine.model_validate(tomllib.loads(BENCH.read_text())))


def driver(frame_s: float = 0.1, **config: object) -> SimulatedDriver:
    settings = SimulatedConfig.model_validate({"speed": 0.0, **config})
    made = SimulatedDriver(settings, context())
    made.frame_s = frame_s
    return made


async def take(frames: AsyncIterator[SampleFrame], count: int) -> list[SampleFrame]:
    return [await anext(frames) for _ in range(count)]


async def opened_frames(source: SimulatedDriver, count: int) -> list[SampleFrame]:
    await source.open()
    frames = source.frames()
    taken = await take(frames, count)
    await frames.aclose()
    await source.close()
    return taken


class FakeTime:
    """A clock that only sleeping moves, and a list of what was slept."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.slept_s: list[float] = []

    def clock(self) -> float:
        return self.now_s

    async def sleep(self, duration_s: float) -> None:
        self.slept_s.append(duration_s)
        self.now_s += duration_s
        await asyncio.sleep(0)


def paced(time: FakeTime, **config: object) -> SimulatedDriver:
    settings = SimulatedConfig.model_validate(config)
    made = SimulatedDriver(settings, context(), clock=time.clock, sleep=time.sleep)
    made.frame_s = 0.02
    return made


async def test_frames_hold_every_channel_at_the_rate_without_a_hole() -> None:
    frames = await opened_frames(driver(frame_s=0.02), 50)
    assert all(set(frame.channels) == set(CHANNELS) for frame in frames)
    assert [len(frame) for frame in frames] == [33, *[20] * 49]
    assert np.array_equal(np.concatenate([f.time_s for f in frames]), np.arange(1013) / 1000.0)


async def test_frame_length_does_not_change_the_samples() -> None:
    short = await opened_frames(driver(frame_s=0.01, hold_s=0.0), 60)
    long = await opened_frames(driver(frame_s=0.2, hold_s=0.0), 3)
    for name in CHANNELS:
        values = [np.concatenate([f.channels[name] for f in frames]) for frames in (short, long)]
        assert values[0].tobytes() == values[1].tobytes()


@pytest.mark.parametrize("speed", [1.0, 10.0])
async def test_pacing_follows_a_fixed_start_without_drift(speed: float) -> None:
    time = FakeTime()
    source = paced(time, speed=speed)
    assert source.paced
    await source.open()
    frames = source.frames()
    for number in range(1, 101):
        (frame,) = await take(frames, 1)
        due_s = 100.0 + (number * 0.02 + 0.013) / speed
        assert time.now_s == pytest.approx(due_s, abs=1e-9)
        assert frame.time_s[-1] == pytest.approx(number * 0.02 + 0.012)
        time.now_s += 0.004 / speed


async def test_a_short_delay_is_caught_up_and_a_long_one_is_let_go() -> None:
    time = FakeTime()
    source = paced(time)
    await source.open()
    frames = source.frames()
    await take(frames, 1)
    time.now_s += 0.5
    await take(frames, 30)
    assert time.now_s == pytest.approx(100.0 + 31 * 0.02 + 0.013)
    time.now_s += 3600.0
    late_s = time.now_s
    caught_up = await take(frames, 50)
    assert time.now_s == pytest.approx(late_s + 49 * 0.02)
    assert caught_up[-1].time_s[-1] == pytest.approx(81 * 0.02 + 0.012)


async def truths(source: SimulatedDriver, count: int) -> list[float]:
    """True preload at the end of each frame, %."""
    await source.open()
    frames = source.frames()
    return [source.readings["true_preload_percent"] for _ in range(count) if await anext(frames)]


async def test_truth_follows_the_scenario_and_its_wear_clock() -> None:
    source = driver(scenario="gradual", life_s=1.0, hold_s=0.5, frame_s=0.1)
    assert source.readings == {}
    end_s = 0.1 * np.arange(1, 21) + 0.012
    assert await truths(source, 20) == pytest.approx(np.interp(end_s, [0.5, 1.5], [10.0, 0.0]))
    await source.close()
    assert source.readings == {}


async def test_a_repeated_scenario_starts_anew_with_its_hold() -> None:
    source = driver(scenario="sudden", life_s=1.0, hold_s=0.52, frame_s=0.25, repeat=True)
    assert await truths(source, 12) == [10.0, 10.0, 10.0, 10.0, 0.0, 0.0] * 2


@pytest.mark.parametrize(
    ("config", "start", "end"),
    [
        ({"scenario": "healthy"}, 100.0 * 510.0 / 7450.0, 100.0 * 510.0 / 7450.0),
        ({"scenario": "healthy", "start_percent": 4.0}, 4.0, 4.0),
        ({"scenario": "partial"}, 7.5, 2.5),
        ({"scenario": "gradual", "start_percent": 6.0, "end_percent": 3.0}, 6.0, 3.0),
    ],
)
async def test_start_and_end_of_the_scenarios(
    config: dict[str, object], start: float, end: float
) -> None:
    source = driver(**config, hold_s=0.0, life_s=1.0, frame_s=1.0)
    first, second = await truths(source, 2)
    assert first == pytest.approx(end, abs=abs(end - start) * 2e-3)
    assert second == pytest.approx(end)


async def test_the_true_machine_reaches_the_torque(tmp_path: Path) -> None:
    truth = tmp_path / "true.toml"
    friction = "[model]\nguide_force_n = 60.0\nbearing_drag_nm = 0.05"
    truth.write_text(BENCH.read_text().replace("[model]", friction, 1))
    plain = await opened_frames(driver(scenario="healthy", frame_s=1.0), 8)
    loaded = await opened_frames(driver(scenario="healthy", frame_s=1.0, truth=truth), 8)
    more = np.abs(np.concatenate([f.channels[TORQUE] for f in loaded])) - np.abs(
        np.concatenate([f.channels[TORQUE] for f in plain])
    )
    assert np.percentile(more, 75) == pytest.approx(60.0 * 0.02 / (2.0 * np.pi) + 0.05, abs=0.03)


async def test_an_effect_may_come_later() -> None:
    tilt = "load_offset:constant_nm=0.3,from_s=2.0"
    plain = await opened_frames(driver(scenario="healthy", frame_s=1.0), 4)
    tilted = await opened_frames(driver(scenario="healthy", frame_s=1.0, effects=[tilt]), 4)
    more = [
        np.median(b.channels[TORQUE] - a.channels[TORQUE])
        for a, b in zip(plain, tilted, strict=True)
    ]
    assert more == pytest.approx([0.0, 0.0, 0.3, 0.3], abs=0.05)


async def test_a_force_comes_from_a_file_again_and_again_and_from_a_process(tmp_path: Path) -> None:
    (tmp_path / "force.csv").write_text("time_s,force_n\n0,100\n1,100\n1.001,300\n2,300\n")
    settings = {"force_file": tmp_path / "force.csv", "force": -400.0, "process": "drilling"}
    frames = await opened_frames(driver(**settings, frame_s=0.5), 12)
    force_n = np.concatenate([frame.channels[EXTERNAL_FORCE] for frame in frames])
    means = force_n[:6000].reshape(12, 500).mean(axis=1)
    assert means[1:7] == pytest.approx([-300.0, -100.0, -100.0, -300.0, -300.0, -100.0], abs=2.0)
    assert means[8:] == pytest.approx([100.0, 100.0, 300.0, 300.0], abs=2.0)


async def test_a_nut_with_clearance_needs_no_preload() -> None:
    bare = {"axis": {"lead_m": 0.02}, "model": {"inertia_kg_m2": 1.5e-3}}
    config = SimulatedConfig(scenario="healthy", start_percent=0.0, speed=0.0)
    source = SimulatedDriver(config, DriverContext("L", Machine.model_validate(bare)))
    assert await truths(source, 2) == [0.0, 0.0]


async def test_a_wrong_configuration_names_its_key(tmp_path: Path) -> None:
    (tmp_path / "force.csv").write_text("time_s,force_n\n0,1\n0,2\n")
    for name, said in (("force.csv", "rising times"), ("no.csv", "No such file")):
        with pytest.raises(DriverMisconfiguredError, match=f"force_file: .*{said}"):
            await driver(force_file=tmp_path / name).open()
    with pytest.raises(
        DriverMisconfiguredError, match=r"motion: 'polka' is not one of .*production"
    ):
        await driver(motion="polka").open()
    with pytest.raises(DriverMisconfiguredError, match=r"effects: no effect 'rust'"):
        await driver(effects=["rust"]).open()
    with pytest.raises(DriverMisconfiguredError, match=r"effects: .* leave a table of"):
        await driver(effects=["inertia_error:change_kg_m2=-0.01"]).open()
    bare = Machine.model_validate({"axis": {"lead_m": 0.02}, "model": {"inertia_kg_m2": 1.5e-3}})
    source = SimulatedDriver(SimulatedConfig(), DriverContext("X", bare))
    with pytest.raises(DriverMisconfiguredError, match=r"machine: axis\.dynamic_load_rating_n"):
        await source.open()
