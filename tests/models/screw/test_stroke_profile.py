"""Preload and stiffness along the stroke against the springs in series that they stand for."""

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.models.commissioned import CommissionedConfig, TransmissionConfig
from edge_service.models.machine import Machine, Quantity
from edge_service.models.screw.stroke_profile import stroke_profile

MASS_KG = 20.0
REST_N_PER_M, NUT_N_PER_M = 5.0e7, 1.0e8
"""Everything but the nut at mid-stroke, and the nut at the fresh preload."""
SLOPE_PER_N = 1.5e-8
COMPLIANCE = 1.0 / REST_N_PER_M + 1.0 / NUT_N_PER_M


def machine(nut_sigma: float = 0.0, *, linear: bool = True, mass: bool = True) -> Machine:
    """The bench with springs that are known by hand and one harmonic of preload."""
    base = load_machine(DEFAULT_MACHINE)
    transmission = TransmissionConfig(
        reference_m=0.4,
        stretch_per_acceleration_s2=MASS_KG * COMPLIANCE,
        stretch_slope_s2_per_m=MASS_KG * SLOPE_PER_N,
        nut_share=1.0 / NUT_N_PER_M / COMPLIANCE,
        nut_share_sigma=nut_sigma,
        reversal_force_n=100.0,
        noise_density_m2_s=1e-16,
    )
    taught = CommissionedConfig(
        stroke_map=((0.1, 0.0),),
        coulomb_nm=0.6,
        noise_density_nm2_s=1e-7,
        motion_s=100.0,
        transmission=transmission if linear else None,
    )
    table = Quantity(value=MASS_KG, tolerance=0.0) if mass else None
    model = base.model.model_copy(update={"table_mass_kg": table})
    return base.model_copy(update={"commissioned": taught, "model": model})


def test_springs_in_series_give_the_stiffness() -> None:
    profile = stroke_profile(machine(), places=5)  # 0, 0.2, 0.4, 0.6, 0.8 m
    assert profile is not None
    fresh = profile.fresh_percent
    percent = fresh / 8.0  # the cube root law: half as stiff
    value, low, high = profile.stiffness(percent, percent, percent)
    # at a quarter of the stroke the harmonic's cosine is 0: the local preload is the mean
    by_hand = 1.0 / (1.0 / REST_N_PER_M + SLOPE_PER_N * (0.2 - 0.4) + 2.0 / NUT_N_PER_M)
    assert value[1] == pytest.approx(by_hand, rel=1e-9)
    assert low == pytest.approx(value, rel=1e-3)
    assert high == pytest.approx(value, rel=1e-3)


def test_the_preload_follows_the_map_and_its_mean_is_the_estimate() -> None:
    profile = stroke_profile(machine(), places=401)
    assert profile is not None
    value, low, high = profile.preload(5.0, 4.0, 6.0)
    assert (value[0], value[200], np.mean(value[:-1])) == pytest.approx((5.5, 4.5, 5.0))
    assert (low[0], high[0]) == pytest.approx((4.4, 6.6))


def test_what_is_not_known_of_the_nut_widens_the_bounds_away_from_the_fresh_preload() -> None:
    profile = stroke_profile(machine(nut_sigma=0.15), places=5)
    assert profile is not None
    fresh = profile.fresh_percent
    value, low, high = profile.stiffness(fresh, fresh, fresh)
    worn, worn_low, worn_high = profile.stiffness(fresh / 8.0, fresh / 8.0, fresh / 8.0)
    assert (high[1] - low[1]) / value[1] < 1e-3
    # 1/k = C + C_n: the error of C_n is 1.96 * 0.15 * C, that of k about k^2 times as much
    expected = 2.0 * 1.96 * 0.15 * COMPLIANCE * worn[1] ** 2
    assert worn_high[1] - worn_low[1] == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("lacking", [{"linear": False}, {"mass": False}])
def test_without_linear_encoder_or_mass_there_is_preload_but_no_stiffness(
    lacking: dict[str, bool],
) -> None:
    profile = stroke_profile(machine(**lacking))
    assert profile is not None
    assert not profile.knows_stiffness
    assert np.all(profile.preload(5.0, 4.0, 6.0)[0] > 0.0)


def test_without_commissioning_nothing_is_known() -> None:
    assert stroke_profile(load_machine(DEFAULT_MACHINE)) is None
