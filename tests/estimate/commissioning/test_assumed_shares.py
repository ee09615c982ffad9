"""Shares that are assumed hold the truth of drawn axes as often as their intervals say."""

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.estimate.commissioning.shares import nut_share
from edge_service.models.machine import Machine, Quantity


def with_nut(stiffness_n_per_m: float, tolerance: float) -> Machine:
    machine = load_machine(DEFAULT_MACHINE)
    nut = Quantity(value=stiffness_n_per_m, tolerance=tolerance)
    model = machine.model.model_copy(update={"nut_stiffness_n_per_m": nut})
    return machine.model_copy(update={"model": model})


@pytest.mark.parametrize("mass_tolerance", [0.0, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("nut_tolerance", [0.02, 0.1, 0.3])
def test_the_nuts_share_is_as_uncertain_as_nut_and_mass(
    nut_tolerance: float, mass_tolerance: float
) -> None:
    """Compliance is a measured stretch over the mass: one is as wrong as the other."""
    rng = np.random.default_rng(17)
    held = []
    for _ in range(300):
        true_share, true_nut = rng.uniform(0.18, 0.38), 1e8
        stated_nut = true_nut * max(1.0 + nut_tolerance * rng.standard_normal(), 0.1)
        wrong_mass = max(1.0 + mass_tolerance * rng.standard_normal(), 0.1)
        compliance = 1.0 / (true_share * true_nut) / wrong_mass
        share, sigma = nut_share(with_nut(stated_nut, nut_tolerance), compliance, mass_tolerance)
        held.append(abs(share - true_share) <= 2.0 * sigma)
    assert np.mean(held) >= 0.85  # a share that reads low has the narrower interval


def test_a_known_mass_leaves_the_stated_nut_alone() -> None:
    share, sigma = nut_share(with_nut(1e8, 0.1), 1.0 / (0.25 * 1e8), 0.02)
    assert share == pytest.approx(0.25)
    assert sigma == pytest.approx(0.25 * 0.1)  # the worse known of nut and mass
