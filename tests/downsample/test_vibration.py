"""Features of a fast signal against formulas."""

import math

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.downsample.vibration import MOST_SENSORS, AxisVibration, orders_of
from edge_service.messages.samples import ANGLE, Floats, SampleFrame, Waveform
from edge_service.models.plant.accelerometer import Accelerometer, AccelerometerSettings

RATE_HZ = 10_000.0
ORDERS = {"screw": 1.0, "ball_pass": 9.56}
BANDS = {"low": (10.0, 1000.0), "high": (1000.0, 5000.0)}


def piece(start_s: float, values: Floats, sensor: str = "a") -> Waveform:
    return Waveform(sensor, "m/s^2", start_s, 1.0 / RATE_HZ, values)


def reduced(
    values: Floats, angle_rad: Floats | None = None, rows: int = 200
) -> list[dict[str, float]]:
    """Columns of each interval of a signal from time 0, its angle at 1 kHz."""
    axis = AxisVibration(ORDERS, BANDS)
    found = []
    for start in range(0, len(values), rows):
        axis.push(piece(start / RATE_HZ, values[start : start + rows]))
        if angle_rad is not None:
            angles = np.arange(start // 10, min((start + rows) // 10, len(angle_rad)))
            axis.follow(SampleFrame(angles / 1000.0, {ANGLE: angle_rad[angles]}))
        if columns := axis.take():
            found.append({name.removeprefix("a."): value for name, value, _ in columns})
    return found


def test_a_sine_has_the_moments_of_a_sine() -> None:
    time_s = np.arange(30_000) / RATE_HZ
    first, *_ = reduced(2.0 * np.sin(2.0 * math.pi * 100.0 * time_s) + 5.0)
    assert (first["rms"], first["peak"]) == pytest.approx((2.0 / math.sqrt(2.0), 2.0), rel=1e-3)
    assert first["kurtosis"] == pytest.approx(1.5, rel=1e-3)
    assert first["low_rms"] == pytest.approx(first["rms"], rel=1e-6)
    assert first["high_rms"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("order", [1.0, 9.56, 9.65])
def test_an_order_is_found_with_its_amplitude_at_any_course_of_the_speed(order: float) -> None:
    time_s = np.arange(30_000) / RATE_HZ
    angle = 2.0 * math.pi * (6.0 * time_s + 1.5 * time_s**2)  # speeding up from 6 to 15 rev/s
    noise = 0.2 * np.random.default_rng(3).standard_normal(len(time_s))
    name = "screw" if order == 1.0 else "ball_pass"
    found = reduced(0.7 * np.sin(order * angle) + noise, angle[::10])
    assert len(found) >= 2
    for each in found[1:]:
        assert each[name] == pytest.approx(0.7, rel=0.05)
        assert each[f"{name}_floor"] < 0.1


def test_a_damaged_raceway_taps_at_the_ball_pass_in_the_envelope() -> None:
    found = {}
    slow = 2.0 * math.pi * 8.0 * np.arange(3000) / 1000.0
    for damage in (0.0, 6.0):
        sensor = Accelerometer(AccelerometerSettings(damage=damage), 5)
        wave = sensor.follow(np.arange(len(slow)) / 1000.0, slow)
        values = np.resize(wave.values, 30_000)
        values[len(wave.values) :] = 0.0
        found[damage] = reduced(values[:29_000], slow)[1]
    sound, damaged = found[0.0], found[6.0]
    assert damaged["envelope_ball_pass"] > 5.0 * damaged["envelope_ball_pass_floor"]
    assert sound["envelope_ball_pass"] < 4.0 * sound["envelope_ball_pass_floor"]
    assert damaged["kurtosis"] > 1.5 * sound["kurtosis"]
    assert sound["ball_pass"] == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize("case", ["rest", "turns round", "unknown angle"])
def test_orders_are_not_reported_without_turning(case: str) -> None:
    time_s = np.arange(30_000) / RATE_HZ
    slow_s = time_s[::10]
    angle = {
        "rest": np.full(len(slow_s), 2.0),
        "turns round": 60.0 * np.sin(2.0 * math.pi * slow_s),
        "unknown angle": None,
    }[case]
    found = reduced(np.sin(2.0 * math.pi * 80.0 * time_s), angle)
    assert len(found) >= 2
    assert all(set(each) == {"rms", "peak", "low_rms", "high_rms", "kurtosis"} for each in found)


def test_a_signal_that_breaks_off_tells_only_whole_intervals() -> None:
    axis = AxisVibration(ORDERS, BANDS)
    values = np.ones(16_000)
    values[::2] = -1.0
    axis.push(piece(0.0, values))
    assert axis.take()
    axis.push(piece(2.2, values))
    assert (axis.gaps, axis.take()) == (1, ())
    axis.push(piece(3.8, values))
    assert axis.take()[0][:2] == ("a.rms", pytest.approx(1.0))


def test_pieces_of_any_size_give_the_same_features() -> None:
    noise = np.random.default_rng(7).standard_normal(38_000)
    whole, parted = (reduced(noise, None, rows) for rows in (38_000, 130))
    assert whole[-1] == pytest.approx(parted[-1])


CLOCKS = {
    "the same piece again and again": lambda number: 0.0,
    "a clock that hardly goes on": lambda number: 1e-9 * number,
    "a clock that goes back": lambda number: 1e6 - number,
    "a clock that begins anew": lambda number: 0.01 * (number % 100),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_what_is_kept_is_bounded_whatever_the_clock_does(clock: str) -> None:
    axis = AxisVibration(ORDERS, BANDS)
    for number in range(3000):
        axis.push(piece(CLOCKS[clock](number), np.ones(100)))
        axis.follow(SampleFrame(0.02 * number + np.arange(20) / 1000.0, {ANGLE: np.zeros(20)}))
    assert sum(map(len, axis._pieces["a"])) <= 2 * 1.6 / 1e-4
    assert axis._angles[-1][0][-1] - axis._angles[0][0][0] < 12.0


def test_orders_are_those_of_the_machine_files_balls() -> None:
    machine = load_machine(DEFAULT_MACHINE)
    assert orders_of(machine) == {"screw": 1.0}
    balls = {"ball_diameter_m": 3.175e-3, "ball_circle_m": 0.0206}
    known = machine.model_copy(update={"axis": machine.axis.model_copy(update=balls)})
    orders = orders_of(known)
    # a ball passes the nut and the screw as often as there are balls per turn of one track
    turn = math.hypot(math.pi * 0.0206, 0.02)
    passes = orders["ball_pass_nut"] + orders["ball_pass_screw_track"]
    assert passes == pytest.approx(turn / 3.175e-3)


def test_sensors_beyond_the_bound_are_refused_and_take_no_place_of_another() -> None:
    axis = AxisVibration(ORDERS, BANDS)
    values = np.random.default_rng(3).standard_normal(20_000)
    names = [f"s{number}" for number in range(MOST_SENSORS + 2)]
    taken = [axis.push(piece(0.0, values, name)) for name in names]
    assert taken == [True] * MOST_SENSORS + [False] * 2
    columns = axis.take()
    assert {each.name.partition(".")[0] for each in columns} == set(names[:MOST_SENSORS])
    assert axis.take() == ()
