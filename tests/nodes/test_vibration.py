"""From the simulated accelerometer to features, and to a file around an event."""

import asyncio
import math
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, ConfigError, load_config, load_machine
from edge_service.config_tables import VibrationConfig
from edge_service.messages.codec.interface import CodecError
from edge_service.messages.event import Event, Severity
from edge_service.messages.header import Header
from edge_service.messages.topics import EVENT, VIB, WAVE
from edge_service.messages.vibration import VibrationFeatures
from edge_service.messages.waveform import Waveform
from edge_service.nodes.vibration_node import MOST_SENSORS, Sensors, orders_of
from edge_service.recordings.reader import open_trace

from .conftest import config_of, running

HEADER = Header(1, 2, 3, 4)


def test_a_waveform_goes_over_the_wire() -> None:
    wave = Waveform("nut", "m/s^2", 12.5, 1e-4, np.random.default_rng(1).standard_normal(200))
    axis, header, decoded = WAVE.decode(WAVE.encode("X", HEADER, wave))
    assert (axis, header, decoded.sensor, decoded.unit) == ("X", HEADER, "nut", "m/s^2")
    assert decoded.start_s == wave.start_s
    assert decoded.period_s == pytest.approx(1e-4, rel=1e-9)
    np.testing.assert_array_equal(decoded.values, wave.values)
    with pytest.raises(CodecError, match="without a clock"):
        WAVE.decode(WAVE.encode("X", HEADER, Waveform("a", "V", 0.0, 1.0, np.zeros(1))))


@pytest.mark.slow
async def test_a_damaged_raceway_is_heard_and_kept_around_an_event(tmp_path: Path) -> None:
    vibration = VibrationConfig(
        orders={"screw": 1.0, "ball_pass": 9.56},
        keep_folder=tmp_path,
        keep_before_s=0.5,
        keep_after_s=0.5,
    )
    settings = {
        "scenario": "healthy",
        "speed": 4.0,
        "accelerometer_rate_hz": 10_000.0,
        "raceway_damage": 8.0,
    }
    config = config_of("simulated", settings, vibration=vibration)
    async with running(config, ("vibration", "acquire")) as service:
        features = service.bus.subscribe(config.keys.all_axes(VIB), VIB)
        alarm = service.bus.publisher(config.keys.key("X", EVENT), EVENT, "X")
        heard: list[VibrationFeatures] = []
        async with asyncio.timeout(30.0):
            async for axis, _, each in features:
                assert axis == "X"
                heard.append(each)
                if len(heard) == 3:
                    event = Event(
                        axis="X",
                        kind="condition_changed",
                        severity=Severity.WARNING,
                        message="",
                        time_ns=1,
                    )
                    alarm.publish(event, 1)
                peaks = [each.envelope_orders["ball_pass"] for each in heard]
                clear = [peak for peak in peaks if peak and peak.amplitude > 4.0 * peak.floor]
                if clear and list(tmp_path.glob("X_nut_acceleration_*.parquet")):
                    break
    (path,) = tmp_path.glob("X_nut_acceleration_*.parquet")
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    assert table.column_names == ["time_s", "nut_acceleration"]
    assert len(table) == pytest.approx(10_000, abs=100)
    assert clear[0].order == pytest.approx(9.56, abs=0.2)
    with pytest.raises(Exception, match="no torque and no position"):
        open_trace(path)


MISTAKES = {
    "band": ("bands_hz = { low = [100.0, 10.0] }", "vibration: bands_hz.low: [100, 10]"),
    "order": ("orders = { screw = 0.0 }", "vibration: orders.screw: 0"),
    "unknown key": ("intervall_s = 1.0", "did you mean 'interval_s'?"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_names_its_key(name: str, tmp_path: Path) -> None:
    text, expected = MISTAKES[name]
    path = tmp_path / "edge.toml"
    path.write_text(f'[vibration]\n{text}\n[[axes]]\nname = "X"\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert expected in str(caught.value)


def test_orders_are_those_of_the_machine_files_balls_unless_stated() -> None:
    machine = load_machine(DEFAULT_MACHINE)
    assert machine.ball_pass_orders is None
    assert orders_of(VibrationConfig(), machine) == {"screw": 1.0}
    balls = {"ball_diameter_m": 3.175e-3, "ball_circle_m": 0.0206}
    known = machine.model_copy(update={"axis": machine.axis.model_copy(update=balls)})
    orders = orders_of(VibrationConfig(), known)
    assert orders["screw"] == 1.0
    # a ball passes the nut and the screw as often as there are balls per turn of one track
    turn = math.hypot(math.pi * 0.0206, 0.02)
    assert orders["ball_pass_nut"] + orders["ball_pass_screw"] == pytest.approx(turn / 3.175e-3)
    assert orders_of(VibrationConfig(orders={"own": 3.0}), known) == {"own": 3.0}


def test_sensors_beyond_the_bound_are_refused_and_take_no_place_of_another() -> None:
    refused: list[str] = []
    machines = {"X": load_machine(DEFAULT_MACHINE), "Y": load_machine(DEFAULT_MACHINE)}
    sensors = Sensors(VibrationConfig(), machines, refused.append)
    values = np.random.default_rng(3).standard_normal(20_000)
    heard = [
        len(sensors.push(axis, Waveform(name, "V", 0.0, 1e-4, values)))
        for axis in machines
        for name in map(str, range(2 * MOST_SENSORS))
    ]
    known = [1] * MOST_SENSORS + [0] * MOST_SENSORS
    assert heard == known + known
    assert refused == ["X"] * MOST_SENSORS + ["Y"] * MOST_SENSORS
    assert len(sensors.push("X", Waveform("0", "V", 2.0, 1e-4, values))) > 0


async def test_a_surplus_sensor_is_counted_by_its_key() -> None:
    config = config_of("simulated", {}, vibration=VibrationConfig())
    key = config.keys.key("X", WAVE)
    async with running(config, ("vibration",)) as service:
        waves = service.bus.publisher(key, WAVE, "X")
        async with asyncio.timeout(10.0):
            while not service.bus.refused()[key, "surplus"]:
                for number in range(MOST_SENSORS + 1):
                    waves.publish(Waveform(str(number), "V", 0.0, 1e-4, np.zeros(10)), 1)
                await asyncio.sleep(0.01)
