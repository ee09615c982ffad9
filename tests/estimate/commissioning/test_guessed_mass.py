"""Commissioning without the table's mass: intervals are as wide as the guess of it is unsure."""

from functools import cache

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.commissioning.shares import nut_share
from edge_service.models.machine import Machine, Quantity

from ...bench.estimator.axis import downsampled
from .plain_axis import PlainAxis


@cache
def learned() -> list[tuple[PlainAxis, Machine]]:
    """Drawn axes, each with its machine as commissioned without the mass."""
    rng = np.random.default_rng(23)
    axes = [drawn(rng) for _ in range(8)]
    return [(axis, learned_of(axis)) for axis in axes]


def drawn(rng: np.random.Generator) -> PlainAxis:
    """An axis whose table has any share of the inertia that tables have."""
    table_kg, ratio_m = float(rng.uniform(5.0, 60.0)), PlainAxis().ratio_m
    share = float(rng.uniform(0.08, 0.5))
    return PlainAxis(
        table_kg=table_kg,
        rotor_kg_m2=table_kg * ratio_m**2 * (1.0 / share - 1.0),
        bearing_nm=float(rng.uniform(0.02, 0.08)),
        guide_n=float(rng.uniform(20.0, 90.0)),
    )


def learned_of(axis: PlainAxis) -> Machine:
    nominal = axis.machine()
    model = nominal.model.model_copy(update={"table_mass_kg": None})
    nominal = nominal.model_copy(update={"model": model})
    return commissioned([downsampled([axis.frame()], nominal)], nominal)


@pytest.mark.slow
def test_guides_and_mass_are_held_as_often_as_said() -> None:
    held = []
    for axis, machine in learned():
        guide, mass = machine.model.guide_force_n, machine.model.table_mass_kg
        assert mass is not None
        held.append(abs(guide.value - axis.guide_n) <= 2.0 * guide.sigma)
        held.append(abs(mass.value - axis.table_kg) <= 2.0 * mass.sigma)
    assert np.mean(held) >= 0.8


def test_guides_at_reversals_have_no_more_friction_than_the_axis() -> None:
    """More would cut off the stretch at a reversal, which then passes for another preload."""
    for axis, machine in learned():
        taught = machine.commissioned
        assert taught is not None
        assert taught.transmission is not None
        left_nm = taught.coulomb_nm - axis.screw_nm
        assert taught.transmission.reversal_force_n * axis.ratio_m <= 1.001 * left_nm


def test_frictions_together_stay_well_known() -> None:
    for axis, machine in learned():
        truth_nm = axis.bearing_nm + axis.guide_n * axis.ratio_m
        together = machine.other_drag_nm
        assert abs(together.value - truth_nm) <= 4.0 * together.sigma
        assert together.tolerance <= 0.05


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
    """The compliance is a measured stretch over the mass, and errs as the mass does."""
    rng, held = np.random.default_rng(17), []
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
