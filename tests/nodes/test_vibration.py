"""From the simulated accelerometer to columns of the feature blocks."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE
from edge_service.downsample.vibration import MOST_SENSORS
from edge_service.messages.samples import Waveform
from edge_service.messages.topics import FEAT, WAVE

from .conftest import config_of, running


@pytest.mark.slow
async def test_a_damaged_raceway_is_heard_at_the_ball_pass(tmp_path: Path) -> None:
    balls = "[axis]\nball_diameter_m = 3.175e-3\nball_circle_m = 0.0206\n"
    machine = tmp_path / "machine.toml"
    machine.write_text(DEFAULT_MACHINE.read_text().replace("[axis]\n", balls, 1))
    settings = {
        "scenario": "healthy",
        "speed": 4.0,
        "accelerometer_hz": 10_000.0,
        "raceway_damage": 8.0,
    }
    config = config_of("simulated", settings, machine)
    async with running(config, ("downsample", "acquire")) as service:
        features = service.bus.subscribe(config.keys.all_axes(FEAT), FEAT)
        async with asyncio.timeout(120.0):
            async for _, _, block in features:
                found = {name: (value, unit) for name, value, unit in block.vibration}
                if found:
                    assert found["nut_acceleration.rms"][1] == "m/s^2"
                peak, _ = found.get("nut_acceleration.envelope_ball_pass_nut", (0.0, ""))
                floor, _ = found.get("nut_acceleration.envelope_ball_pass_nut_floor", (1.0, ""))
                if peak > 4.0 * floor:
                    break


async def test_a_surplus_sensor_is_counted() -> None:
    config = config_of("simulated", {})
    key = config.keys.key("X", WAVE)
    async with running(config, ("downsample",)) as service:
        waves = service.bus.publisher(key, WAVE, "X")
        async with asyncio.timeout(30.0):
            while not service.bus.refused()["wave", "surplus"]:
                for number in range(MOST_SENSORS + 1):
                    waves.publish(Waveform(str(number), "V", 0.0, 1e-4, np.zeros(10)), 1)
                await asyncio.sleep(0.01)
