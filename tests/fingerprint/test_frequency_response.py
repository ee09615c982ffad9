"""Frequency response, two-mass fit and shaken antiresonance, against axes written differently."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from edge_service.fingerprint.response.frequency_response import (
    Complexes,
    FrequencyResponse,
    drive_response,
    drive_responses_along,
    sampling_correction,
)
from edge_service.fingerprint.response.notch import notch_of
from edge_service.fingerprint.response.two_mass_fit import TwoMassFit, fit_two_mass, modes
from edge_service.messages.samples import ANGLE, SETPOINT, TORQUE, Floats, SampleFrame
from edge_service.models.commissioned import Notch
from edge_service.models.feed_drive import FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, motion_limits
from edge_service.models.plant.two_mass import axial_compliance

from .conftest import FRESH, run_axis, setpoints_of
from .shaken_axis import STEP_S, Axis, driven, shaken, smooth

INERTIA, NOTCH_HZ, DAMPING, RATIO = 1.5e-3, 150.0, 0.03, 1.2
AXIS = Axis()
HALF = replace(AXIS, preload=0.5)
"""A nut of a quarter of the compliance with half of its preload: 2^(1/3) as soft."""
HALF_HZ = AXIS.antiresonance_hz * (0.75 + 0.25 * 2.0 ** (1.0 / 3.0)) ** -0.5


def continuous(frequency_hz: Floats) -> Complexes:
    """Motor speed over torque of the two-mass model (5.3.19 with equal dampers)."""
    s = 2j * math.pi * frequency_hz
    notch = 2.0 * math.pi * NOTCH_HZ
    peak, peak_damping = notch * RATIO, DAMPING * RATIO
    above = (s / notch) ** 2 + 2.0 * DAMPING * s / notch + 1.0
    below = (s / peak) ** 2 + 2.0 * peak_damping * s / peak + 1.0
    return np.asarray(above / below / (INERTIA * s), dtype=np.complex128)


def held_record(seed: int, seconds: float = 60.0, noise_rad: float = 0.0) -> SampleFrame:
    """Angle of the model to a held random torque, by scipy's exact discretisation."""
    notch = 2.0 * math.pi * NOTCH_HZ
    peak = notch * RATIO
    above = [1.0 / notch**2, 2.0 * DAMPING / notch, 1.0]
    below = [1.0 / peak**2, 2.0 * DAMPING * RATIO / peak, 1.0]
    plant = signal.StateSpace(*signal.tf2ss(above, np.polymul(below, [INERTIA, 0.0, 0.0])))
    discrete = plant.to_discrete(1e-3)
    random = np.random.default_rng(seed)
    count = round(1000.0 * seconds)
    torque = random.standard_normal(count)
    _, angle, _ = signal.dlsim(discrete, torque)
    angle = angle[:, 0] + noise_rad * random.standard_normal(count)
    return SampleFrame(np.arange(count) / 1000.0, {ANGLE: angle, TORQUE: torque})


def assert_is_the_model(found: TwoMassFit) -> None:
    assert found.inertia.holds(INERTIA)
    assert found.antiresonance.holds(NOTCH_HZ)
    assert found.resonance.holds(NOTCH_HZ * RATIO)
    assert found.antiresonance_damping.holds(DAMPING)
    assert found.resonance_damping.holds(DAMPING * RATIO)
    assert found.table_share.holds(1.0 - RATIO**-2)
    assert found.delay.holds(0.0)


def exact_response(low_hz: float, high_hz: float, seed: int = 1) -> FrequencyResponse:
    """The formula with 2 % of complex noise."""
    frequency = np.arange(low_hz, high_hz, 2.0)
    random = np.random.default_rng(seed)
    noise = random.standard_normal((2, len(frequency))) * 0.02
    return FrequencyResponse(
        frequency,
        continuous(frequency) * (1.0 + noise[0] + 1j * noise[1]),
        np.full(len(frequency), 0.02),
        np.ones(len(frequency)),
    )


def test_the_fit_finds_the_formula() -> None:
    found = fit_two_mass(exact_response(10.0, 400.0))
    assert_is_the_model(found)
    assert found.resonance.sigma < 1.0
    frequency = np.array([20.0, 100.0, 170.0, 300.0])
    np.testing.assert_allclose(found.response(frequency), continuous(frequency), rtol=0.03)


@pytest.mark.parametrize(("damping", "rings"), [(0.7, True), (0.72, False), (1.03, False)])
def test_a_mode_without_a_peak_is_no_resonance(damping: float, rings: bool) -> None:
    found = fit_two_mass(exact_response(10.0, 400.0))
    damped = replace(found, resonance_damping=replace(found.resonance_damping, value=damping))
    figures = modes(damped)
    assert set(figures) == {"antiresonance_hz", "resonance_hz", "resonance_damping", "table_share"}
    assert all(each.determined is rings for each in figures.values())
    assert rings or all("no resonance" in each.note for each in figures.values())


def test_a_held_torque_is_distinguished_from_a_continuous_one() -> None:
    record = held_record(1, 20.0)
    measured = drive_response([record]).within(10.0, 400.0)
    assert_is_the_model(fit_two_mass(measured))
    far = measured.within(200.0, 400.0)
    flexible = np.abs(far.response / continuous(far.frequency_hz) - 1.0)
    assert np.median(flexible) < 0.05


def multisine(count: int, seed: int) -> Floats:
    """Slow travel in one direction with all lines of 5 to 300 Hz on top, (count, 3)."""
    random = np.random.default_rng(seed)
    time_s = np.arange(count) / 1000.0
    turning = 2.0 * math.pi * np.arange(5.0, 301.0)
    angle = np.outer(time_s, turning) + random.uniform(0.0, 2.0 * math.pi, len(turning))
    size_m_s2 = 0.02
    position = 0.4 + 0.012 * time_s - size_m_s2 * (np.sin(angle) / turning**2).sum(axis=1)
    speed = 0.012 - size_m_s2 * (np.cos(angle) / turning).sum(axis=1)
    return np.column_stack((position, speed, size_m_s2 * np.sin(angle).sum(axis=1)))


def recorded(settings: FeedDriveSettings, machine: Machine, motion: str, seed: int) -> SampleFrame:
    limits = motion_limits(machine)
    segments = MOTIONS[motion].plan(limits, np.random.default_rng((seed, 1))).segments
    return run_axis(settings, setpoints_of(segments, limits.low_m), seed)


@pytest.mark.slow
@pytest.mark.parametrize(("motion", "tolerance"), [("multisine", 0.015), ("chirp", 0.03)])
def test_a_resonance_that_moves_with_the_nut_is_not_damped_more(
    bench: Machine, settings: FeedDriveSettings, motion: str, tolerance: float
) -> None:
    """Over the 220 and 420 mm of these tests the resonance changes by 6 and 11 %."""
    places = drive_responses_along([recorded(settings, bench, motion, 1)])
    found = fit_two_mass([place.within(5.0, 400.0) for place in places])
    plant, place_m = settings.plant, found.place_rad * settings.plant.ratio_m_per_rad
    stiffness = 1.0 / axial_compliance(plant, place_m, FRESH)
    damping = 0.5 * plant.damping_n_s_per_m / math.sqrt(plant.table_mass_kg * stiffness)
    notch_hz = math.sqrt(stiffness / plant.table_mass_kg) / (2.0 * math.pi)
    assert found.antiresonance_damping.value == pytest.approx(damping, rel=tolerance)
    assert found.antiresonance.value == pytest.approx(notch_hz, rel=2e-3)
    assert found.inertia.value == pytest.approx(1.5e-3, rel=2e-3)
    assert found.viscous.value == pytest.approx(5e-3, rel=0.15)
    steeper = axial_compliance(plant, place_m + 0.1, FRESH) * stiffness - 1.0
    per_rad = steeper / 0.1 * plant.ratio_m_per_rad
    assert found.model.slope == pytest.approx(per_rad, rel=0.1)


def test_whole_periods_of_a_repeated_reference_need_no_window() -> None:
    """Twenty periods of a multisine through the model: exact at every line, in noise at none."""
    period = multisine(1000, 3)[:, 2]
    frequency = np.fft.rfftfreq(1000, 1e-3)
    lines = np.flatnonzero((frequency >= 5.0) & (frequency <= 300.0))
    torque = np.fft.rfft(period)
    angle = np.zeros_like(torque)
    s = 2j * math.pi * frequency[lines]
    angle[lines] = torque[lines] * continuous(frequency[lines]) / s
    channels = {
        TORQUE: np.tile(period, 20),
        ANGLE: np.tile(np.fft.irfft(angle, 1000), 20),
        SETPOINT: np.tile(np.fft.irfft(angle, 1000), 20),
    }
    frame = SampleFrame(np.arange(20_000) / 1000.0, channels)
    found = drive_response([frame]).within(5.0, 300.0)
    assert (found.resolution_hz, len(found.frequency_hz)) == (0.0, 296)
    s = 2j * math.pi * found.frequency_hz
    by_difference = 1e-3 * s / (1.0 - np.exp(-1e-3 * s))
    held = sampling_correction(found.frequency_hz, 1e-3)
    expected = continuous(found.frequency_hz) * held / by_difference
    np.testing.assert_allclose(found.response, expected, rtol=1e-6)


def test_bad_input_is_one_line() -> None:
    with pytest.raises(ValueError, match="no unbroken run of 1 s"):
        drive_response([held_record(1, 0.5)])
    with pytest.raises(ValueError, match=f"the recording lacks {TORQUE}"):
        frame = held_record(1, 2.0)
        drive_response([SampleFrame(frame.time_s, {ANGLE: frame.channels[ANGLE]})])
    with pytest.raises(ValueError, match="9 coherent frequencies"):
        fit_two_mass(exact_response(10.0, 28.0))
    assert SETPOINT not in held_record(1, 2.0).channels


def seen(axis: Axis, rate_hz: float = 1000.0) -> Notch:
    found = notch_of(shaken(axis, 3, rate_hz))
    assert found is not None
    return found


@pytest.mark.parametrize("rate_hz", [500.0, 1000.0, 2000.0])
def test_antiresonance_is_found_and_falls_with_the_preload_by_the_cube_root(rate_hz: float) -> None:
    fresh, worn = seen(AXIS, rate_hz), seen(HALF, rate_hz)
    assert fresh.antiresonance_hz == pytest.approx(AXIS.antiresonance_hz, rel=0.01)
    assert worn.antiresonance_hz / fresh.antiresonance_hz == pytest.approx(
        HALF_HZ / AXIS.antiresonance_hz, rel=0.002
    )
    table = AXIS.table_kg * AXIS.radius_m**2 / AXIS.inertia_kg_m2
    assert fresh.inertia_ratio == pytest.approx(table, rel=0.08)
    assert fresh.damping_ratio == pytest.approx(AXIS.damping, rel=0.15)
    friction_nm = AXIS.nut_nm + AXIS.guide_n * AXIS.radius_m
    assert fresh.friction_nm == pytest.approx(friction_nm, rel=0.05)
    assert fresh.feed_rad_s == pytest.approx(0.02 / AXIS.radius_m, rel=0.02)


@pytest.mark.parametrize(
    "change",
    [
        {"friction": 0.65},
        {"guide_n": 120.0},
        {"torque_factor": 0.96},
        {"feedforward": False},
        {"hanging_n": 300.0},
    ],
    ids=str,
)
def test_neither_grease_nor_warmth_nor_torque_constant_moves_it(change: dict[str, float]) -> None:
    changed = replace(AXIS, **change)  # type: ignore[arg-type]
    expected = (changed.stiffness() / changed.table_kg) ** 0.5 / 2.0 / np.pi
    found = seen(changed).antiresonance_hz / seen(AXIS).antiresonance_hz
    assert found == pytest.approx(expected / AXIS.antiresonance_hz, rel=0.004)


def test_a_payload_shows_in_the_ratio_of_the_inertias() -> None:
    heavier = replace(AXIS, payload_kg=18.0)
    ratio = seen(heavier).inertia_ratio / seen(AXIS).inertia_ratio
    assert ratio == pytest.approx(1.3, rel=0.03)
    assert seen(heavier).antiresonance_hz < 0.9 * seen(AXIS).antiresonance_hz


@pytest.mark.parametrize(
    ("axis", "how", "reason"),
    [
        (AXIS, {"feed_m_s": 0.0}, "reversed or stood"),
        (AXIS, {"speed_share": 1.4}, "reversed or stood"),
        (replace(AXIS, antiresonance_hz=171.0), {"rate_hz": 500.0}, "needs 5.. samples/s"),
        (replace(AXIS, base_kg=600.0, base_hz=130.0), {}, "a second mode"),
        (
            replace(AXIS, feedforward=False, antiresonance_hz=222.0),
            {},
            "coherence of|no antiresonance",
        ),
    ],
    ids=["no feed", "turns back", "too slow a rate", "a bed beside it", "hardly shaken"],
)
def test_a_test_that_cannot_tell_is_refused(axis: Axis, how: dict[str, float], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        notch_of(shaken(axis, 3, **how))


def test_neither_production_nor_standstill_is_a_test() -> None:
    speed = [0.0, 0.3, 0.3, 0.0, -0.2, -0.2, 0.0, 0.05, *([0.02] * 6), 0.0, -0.3, 0.0] * 2
    assert notch_of(driven(AXIS, smooth(speed), 1)) is None
    assert notch_of(driven(AXIS, np.zeros(round(10.0 / STEP_S)), 1)) is None
