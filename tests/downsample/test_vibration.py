"""Features of a fast signal against formulas."""

import math

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.downsample.vibration import (
    MOST_SENSORS,
    AxisVibration,
    VibrationFeatures,
    VibrationReducer,
    VibrationSettings,
    orders_of,
)
from edge_service.messages.samples import Floats
from edge_service.messages.waveform import Waveform
from edge_service.models.plant.accelerometer import Accelerometer, AccelerometerSettings

RATE_HZ = 10_000.0
ORDERS = {"screw": 1.0, "ball_pass": 9.56}


def reduced(
    values: Floats, angle_rad: Floats | None = None, piece: int = 200, **settings: object
) -> list[VibrationFeatures]:
    """Features of a signal from time 0, its angle at 1 kHz."""
    reducer = VibrationReducer(VibrationSettings(orders=ORDERS, **settings))  # type: ignore[arg-type]
    features: list[VibrationFeatures] = []
    for start in range(0, len(values), piece):
        if angle_rad is not None:
            rows = np.arange(start // 10, min((start + piece) // 10, len(angle_rad)))
            reducer.follow(rows / 1000.0, angle_rad[rows])
        part = values[start : start + piece]
        features += reducer.push(Waveform("a", "m/s^2", start / RATE_HZ, 1.0 / RATE_HZ, part))
    return features


def turning(seconds: float, revs_per_s: float = 8.0) -> tuple[Floats, Floats]:
    """Angle at the sensor's rate and at 1 kHz, at constant speed."""
    fast = 2.0 * math.pi * revs_per_s * np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    return fast, fast[::10]


def test_a_sine_has_the_moments_of_a_sine() -> None:
    time_s = np.arange(30_000) / RATE_HZ
    first, *_ = reduced(2.0 * np.sin(2.0 * math.pi * 100.0 * time_s) + 5.0)
    assert first.rms == pytest.approx(2.0 / math.sqrt(2.0), rel=1e-3)
    assert first.peak == pytest.approx(2.0, rel=1e-3)
    assert first.kurtosis == pytest.approx(1.5, rel=1e-3)
    assert first.bands["low"] == pytest.approx(first.rms, rel=1e-6)
    assert first.bands["high"] == pytest.approx(0.0, abs=1e-9)
    assert first.duration_s == pytest.approx(1.0)


def test_noise_has_the_moments_of_a_gaussian_and_fills_the_bands_evenly() -> None:
    noise = np.random.default_rng(2).standard_normal(40_000)
    for each in reduced(noise):
        assert each.kurtosis == pytest.approx(3.0, abs=0.3)
        assert each.bands["low"] ** 2 == pytest.approx(990.0 / 5000.0, rel=0.1)
        assert each.bands["high"] ** 2 == pytest.approx(4000.0 / 5000.0, rel=0.05)


@pytest.mark.parametrize("order", [1.0, 9.56, 9.65])
def test_an_order_is_found_with_its_amplitude_at_any_course_of_the_speed(order: float) -> None:
    time_s = np.arange(30_000) / RATE_HZ
    angle = 2.0 * math.pi * (6.0 * time_s + 1.5 * time_s**2)  # speeding up from 6 to 15 rev/s
    noise = 0.2 * np.random.default_rng(3).standard_normal(len(time_s))
    name = "screw" if order == 1.0 else "ball_pass"
    for each in reduced(0.7 * np.sin(order * angle) + noise, angle[::10]):
        peak = each.orders[name]
        assert peak is not None
        assert peak.amplitude == pytest.approx(0.7, rel=0.05)
        assert peak.order == pytest.approx(order, abs=0.03)
        assert peak.floor < 0.1


def test_a_damaged_raceway_taps_at_the_ball_pass_in_the_envelope() -> None:
    found = {}
    for damage in (0.0, 6.0):
        angle, slow = turning(3.0)
        sensor = Accelerometer(AccelerometerSettings(damage=damage), 5)
        wave = sensor.follow(np.arange(len(slow)) / 1000.0, slow)
        values = np.resize(wave.values, len(angle))
        values[len(wave.values) :] = 0.0
        found[damage] = reduced(values[:29_000], slow)[0]
    sound, damaged = found[0.0], found[6.0]
    peak, none = damaged.envelope_orders["ball_pass"], sound.envelope_orders["ball_pass"]
    assert peak is not None
    assert none is not None
    assert peak.amplitude > 5.0 * peak.floor
    assert none.amplitude < 4.0 * none.floor
    assert peak.order == pytest.approx(9.56, abs=0.1)
    assert damaged.kurtosis is not None
    assert sound.kurtosis is not None
    assert damaged.kurtosis > 1.5 * sound.kurtosis
    assert sound.orders["ball_pass"] is not None
    assert sound.orders["ball_pass"].amplitude == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize("case", ["rest", "turns round", "unknown angle"])
def test_orders_are_not_reported_without_turning(case: str) -> None:
    time_s = np.arange(30_000) / RATE_HZ
    values = np.sin(2.0 * math.pi * 80.0 * time_s)
    slow_s = time_s[::10]
    angle = {
        "rest": np.full(len(slow_s), 2.0),
        "turns round": 60.0 * np.sin(2.0 * math.pi * slow_s),
        "unknown angle": None,
    }[case]
    features = reduced(values, angle)
    assert len(features) >= 2
    for each in features:
        assert each.orders == dict.fromkeys(ORDERS)
        assert each.envelope_orders == dict.fromkeys(ORDERS)


def test_a_signal_that_breaks_off_tells_only_whole_intervals() -> None:
    reducer = VibrationReducer(VibrationSettings())
    values = np.ones(15_000)
    values[::2] = -1.0
    assert len(reducer.push(Waveform("a", "V", 0.0, 1e-4, values))) == 1
    blocks = reducer.push(Waveform("a", "V", 2.2, 1e-4, values))
    assert reducer.gaps == 1
    blocks += reducer.push(Waveform("a", "V", 3.7, 1e-4, values))
    assert [each.time_s for each in blocks] == pytest.approx([4.0])
    assert blocks[0].rms == pytest.approx(1.0)


def test_pieces_of_any_size_give_the_same_features() -> None:
    noise = np.random.default_rng(7).standard_normal(32_000)
    _, slow = turning(3.2)
    whole, parted = (reduced(noise, slow, piece) for piece in (32_000, 130))
    assert len(whole) == len(parted) == 3
    for a, b in zip(whole, parted, strict=True):
        assert a.rms == pytest.approx(b.rms)
        assert a.orders["screw"] is not None
        assert b.orders["screw"] is not None
        assert a.orders["screw"].amplitude == pytest.approx(b.orders["screw"].amplitude, rel=1e-3)


CLOCKS = {
    "the same piece again and again": lambda number: 0.0,
    "a clock that hardly goes on": lambda number: 1e-9 * number,
    "a clock that goes back": lambda number: 1e6 - number,
    "a clock that begins anew": lambda number: 0.01 * (number % 100),
}


@pytest.mark.parametrize("clock", CLOCKS)
def test_what_is_kept_of_a_signal_is_bounded_whatever_its_clock_does(clock: str) -> None:
    reducer = VibrationReducer(VibrationSettings())
    for number in range(3000):
        reducer.push(Waveform("a", "V", CLOCKS[clock](number), 1e-4, np.ones(100)))
    assert sum(map(len, reducer._pieces)) <= 2 * 1.6 / 1e-4


def test_the_angle_is_bounded_while_no_signal_comes_and_when_its_clock_begins_anew() -> None:
    reducer = VibrationReducer(VibrationSettings())
    for begin_s in (1000.0, 0.0):
        for number in range(3000):
            reducer.follow(begin_s + 0.02 * number + np.arange(20) / 1000.0, np.zeros(20))
    kept = np.concatenate([times for times, _ in reducer._angles])
    assert kept[-1] == pytest.approx(60.0, abs=0.01)
    assert kept[-1] - kept[0] < 12.0


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
    axis = AxisVibration(VibrationSettings())
    values = np.random.default_rng(3).standard_normal(20_000)
    names = [f"s{number}" for number in range(MOST_SENSORS + 2)]
    taken = [axis.push(Waveform(name, "V", 0.0, 1e-4, values)) for name in names]
    assert taken == [True] * MOST_SENSORS + [False] * 2
    columns = axis.take()
    assert {each.name.partition(".")[0] for each in columns} == set(names[:MOST_SENSORS])
    assert {each.name for each in columns} >= {"s0.rms", "s0.low_rms", "s0.kurtosis"}
    assert axis.take() == ()
