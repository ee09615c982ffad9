"""Commissioning recovers what the plant is made of, and refuses what cannot tell it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.commissioning.phases import CommissioningError
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Quantity
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import axial_compliance

from ...bench.estimator.axis import OwnAxis, downsampled, healthy, true_machine

AXIS = OwnAxis(1)
NOMINAL = AXIS.nominal()
INERTIA, VISCOUS, COULOMB = 1.5e-3, 5e-3, 0.35


def rigid(
    speeds: tuple[float, ...],
    directions: tuple[float, ...] = (1.0, -1.0),
    ramp_s: float = 0.3,
    cruise_s: float = 1.5,
    interval_s: float = 0.1,
    dry_nm: float = 0.0,
) -> list[FeatureBlock]:
    """Moves of a rigid axis, J a + D v + C sgn v with noise, at given speeds in rad/s.

    `dry_nm` is the excess of friction without a film, which builds up in 0.15 s at 3 rad/s.
    """
    parts = []
    for _ in range(3):
        for speed in speeds:
            up = np.linspace(0.0, speed, round(ramp_s * 1e3), endpoint=False)
            move = np.concatenate([up, np.full(round(1e3 * cruise_s), speed), up[::-1]])
            for direction in directions:
                parts += [direction * move, np.zeros(200)]
    speed = np.concatenate(parts)
    film = lfilter([1.0 / 150.0], [1.0, 1.0 / 150.0 - 1.0], np.abs(speed))
    torque = torque_of(speed) + dry_nm * np.sign(speed) * np.exp(-film / 3.0)
    return downsampled([frame_of(speed, torque)], NOMINAL, interval_s)


def torque_of(speed: Floats) -> Floats:
    """Held from row to row, the speed rising evenly between rows."""
    after = np.append(speed[1:], speed[-1])
    mean = 0.5 * (speed + after)
    return np.asarray(INERTIA * (after - speed) * 1e3 + VISCOUS * mean + COULOMB * np.sign(mean))


def frame_of(speed: Floats, torque: Floats) -> SampleFrame:
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((2, len(speed)))
    angle = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    channels = {TORQUE: torque + 0.02 * noise[0], ANGLE: angle + 5e-6 * noise[1]}
    return SampleFrame(np.arange(len(speed)) / 1e3, channels)


def sigmas(quantity: Quantity, truth: float) -> float:
    return abs(quantity.value - truth) / quantity.sigma


def test_a_rigid_axis_is_recovered_within_its_intervals() -> None:
    machine = commissioned([rigid((10.0, 30.0, 60.0, 100.0))], NOMINAL)
    taught = machine.commissioned
    assert taught is not None and taught.transmission is None
    assert sigmas(machine.model.inertia_kg_m2, INERTIA) < 3.0
    assert sigmas(machine.model.viscous_nm_s_per_rad, VISCOUS) < 3.0
    assert taught.coulomb_nm == pytest.approx(COULOMB, rel=0.005)
    assert machine.model.inertia_kg_m2.tolerance < 0.01


def test_friction_that_all_moves_have_alike_is_no_change_of_the_inertia() -> None:
    """In wide windows a film that builds up in every move looks like 2.4 times the inertia."""
    gentle, quick = (
        rigid(speeds, ramp_s=ramp_s, cruise_s=0.5, interval_s=0.3, dry_nm=0.1)
        for speeds, ramp_s in (((2.5, 5.0, 10.0), 1.0), ((10.0, 30.0, 60.0, 100.0), 0.1))
    )
    inertia = commissioned([gentle, quick], NOMINAL).model.inertia_kg_m2
    assert sigmas(inertia, INERTIA) < 3.0


@pytest.mark.slow
@pytest.mark.smoke
def test_the_plant_is_recovered() -> None:
    """With Stribeck friction and cogging, which the balance has only in part: to half a percent."""
    truth, machine = true_machine(AXIS), AXIS.commissioned()
    taught, model = machine.commissioned, machine.model
    assert taught is not None
    assert model.inertia_kg_m2.value == pytest.approx(truth.model.inertia_kg_m2.value, rel=5e-3)
    viscous = truth.model.viscous_nm_s_per_rad.value
    assert model.viscous_nm_s_per_rad.value == pytest.approx(viscous, rel=5e-3)
    drag = truth.model.preload_drag_nm
    assert drag is not None
    whole_nm = drag.value + truth.other_drag_nm.value
    assert taught.coulomb_nm == pytest.approx(whole_nm, rel=5e-3)
    assert model.guide_force_n.value == pytest.approx(truth.model.guide_force_n.value, rel=0.02)


@pytest.mark.parametrize("axis", [AXIS, OwnAxis(2, arrangement="fixed-fixed")])
def test_the_series_stiffness_is_recovered_along_the_stroke(axis: OwnAxis) -> None:
    taught, truth = axis.commissioned().commissioned, true_machine(axis)
    assert taught is not None and taught.transmission is not None
    transmission, plant, table = taught.transmission, plant_of(truth), truth.model.table_mass_kg
    assert table is not None
    here = transmission.reference_m
    for away in (-0.3, 0.0, 0.3):
        stretch_s2 = transmission.stretch_per_acceleration_s2
        stretch_s2 += away * transmission.stretch_slope_s2_per_m
        stretch_s2 += away**2 * transmission.stretch_bow_s2_per_m2
        compliance = axial_compliance(plant, here + away, AXIS.fresh_percent)
        assert stretch_s2 == pytest.approx(table.value * compliance, rel=5e-3)
    guide_n = truth.model.guide_force_n.value
    assert transmission.reversal_force_n == pytest.approx(guide_n, rel=0.02)


def test_the_order_of_recordings_means_nothing() -> None:
    numbers = []
    for machine in (AXIS.commissioned(), commissioned(healthy(AXIS)[::-1], NOMINAL)):
        taught = machine.commissioned
        assert taught is not None and taught.transmission is not None
        stretch_s2 = taught.transmission.stretch_per_acceleration_s2
        numbers.append((machine.model.inertia_kg_m2.value, taught.coulomb_nm, stretch_s2))
    assert numbers[0][:2] == pytest.approx(numbers[1][:2], rel=1e-9)
    assert numbers[0][2] == pytest.approx(numbers[1][2], rel=1e-6)


@pytest.mark.parametrize(
    ("blocks", "reason"),
    [
        ([], "steady motion"),
        ([rigid((0.0,))], "steady motion"),
        ([rigid((10.0, 40.0, 80.0), directions=(1.0,))], "negative direction"),
        ([rigid((10.0, 40.0, 80.0), directions=(-1.0,))], "positive direction"),
        ([rigid((40.0,), ramp_s=0.01)], "one speed"),
        ([rigid((10.0, 20.0, 40.0), ramp_s=3.0)], "accelerations"),
    ],
    ids=["empty", "rest", "forward only", "backward only", "one speed", "no acceleration"],
)
def test_it_says_which_motion_is_missing(blocks: list[list[FeatureBlock]], reason: str) -> None:
    with pytest.raises(CommissioningError, match=reason) as caught:
        commissioned(blocks, NOMINAL)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("channel", [TORQUE, ANGLE])
def test_a_swapped_sign_is_refused(channel: str) -> None:
    percent = np.full(60_000, AXIS.fresh_percent)
    frames = [
        SampleFrame(frame.time_s, {**frame.channels, channel: -frame.channels[channel]})
        for frame in AXIS.frames("production", percent, 11)
    ]
    with pytest.raises(CommissioningError, match="signs"):
        commissioned([downsampled(frames, NOMINAL)], NOMINAL)


def test_less_friction_than_the_fresh_screw_alone_is_refused() -> None:
    drag = Quantity(value=1.2 * COULOMB)
    model = NOMINAL.model.model_copy(update={"preload_drag_nm": drag})
    with pytest.raises(CommissioningError, match="less than the fresh screw"):
        commissioned([rigid((10.0, 30.0, 60.0))], NOMINAL.model_copy(update={"model": model}))


def test_intervals_with_a_fault_teach_nothing() -> None:
    """A second recording without the torque channel changes no number."""
    good = rigid((10.0, 30.0, 60.0, 100.0))
    spoiled = downsampled([frame_of(np.full(3000, 50.0), np.full(3000, np.nan))], NOMINAL)
    assert spoiled
    assert commissioned([good, spoiled], NOMINAL) == commissioned([good], NOMINAL)


def test_a_linear_encoder_that_never_moves_is_no_transmission() -> None:
    speed = np.tile(np.concatenate([np.linspace(0, 60, 400), np.linspace(60, 0, 400)]), 20)
    speed *= np.repeat(np.resize([1.0, -1.0], 20), 800)
    frame = frame_of(speed, torque_of(speed))
    still = SampleFrame(frame.time_s, {**frame.channels, TABLE_POSITION: np.full(len(speed), 0.4)})
    taught = commissioned([downsampled([still], NOMINAL)], NOMINAL).commissioned
    assert taught is not None and taught.transmission is None
