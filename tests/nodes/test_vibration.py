"""From the simulated accelerometer to columns of the feature blocks."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, ConfigError, load_config
from edge_service.downsample.vibration import MOST_SENSORS
from edge_service.messages.codec import CodecError, Header
from edge_service.messages.samples import Waveform
from edge_service.messages.topics import FEAT, WAVE

from .conftest import config_of, running

HEADER = Header(1, 2, 3, 4)


def test_a_waveform_goes_over_the_wire() -> None:
    wave = Waveform("nut", "m/s^2", 12.5, 1e-4, np.random.default_rng(1).standard_normal(200))
    axis, header, decoded = WAVE.decode(WAVE.encode("X", HEADER, wave))
    assert (axis, header, decoded.sensor, decoded.unit) == ("X", HEADER, "nut", "m/s^2")
    assert decoded.start_s == wave.start_s
    assert decoded.period_s == pytest.approx(1e-4, rel=1e-9)
    np.testing.assert_array_equal(decoded.values, wave.values)
    with pytest.raises(CodecError, match="without rows"):
        WAVE.decode(WAVE.encode("X", HEADER, Waveform("a", "V", 0.0, 1.0, np.zeros(1))))


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
    config = config_of("simulated", settings)
    axis = config.axes[0].model_copy(update={"machine": machine})
    config = config.model_copy(update={"axes": (axis,)})
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


MISTAKES = {
    "band": ("bands_hz = { low = [100.0, 10.0] }", "vibration: bands_hz.low: [100, 10]"),
    "gone": ("interval_s = 1.0", "vibration.interval_s: gone"),
    "unknown key": ("band_hz = 1.0", "did you mean vibration.bands_hz?"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_names_its_key(name: str, tmp_path: Path) -> None:
    text, expected = MISTAKES[name]
    path = tmp_path / "edge.toml"
    path.write_text(f'[vibration]\n{text}\n[[axes]]\nname = "X"\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert expected in str(caught.value)


async def test_a_surplus_sensor_is_counted_by_its_key() -> None:
    config = config_of("simulated", {})
    key = config.keys.key("X", WAVE)
    async with running(config, ("downsample",)) as service:
        waves = service.bus.publisher(key, WAVE, "X")
        async with asyncio.timeout(30.0):
            while not service.bus.refused()[key, "surplus"]:
                for number in range(MOST_SENSORS + 1):
                    waves.publish(Waveform(str(number), "V", 0.0, 1e-4, np.zeros(10)), 1)
                await asyncio.sleep(0.01)
