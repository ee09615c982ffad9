"""Springs in series along the stroke, motor to table, with tolerances (thesis, 5.3.1-5.3.11)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from edge_service.messages.samples import Floats
from edge_service.models.bounds import require_positive
from edge_service.models.machine import Machine, Quantity
from edge_service.models.plant.from_machine import (
    BEARING_N_PER_M,
    COUPLING_NM_PER_RAD,
    NUT_CATALOGUE_N_PER_M,
    SCREW_DIAMETER_M,
    SCREW_LENGTH_M,
)
from edge_service.models.screw.nut_law import (
    CATALOGUE_PRELOAD_PERCENT,
    LEAST_NUT_LOAD_PERCENT,
    NUT_MODEL_FACTOR,
    catalogue_nut_stiffness,
    nut_stiffness,
)
from edge_service.models.screw.stiffness import STEEL_MODULUS_PA, screw_area, screw_compliance

DATA_SHEET_TOLERANCE = 0.1
"""Relative standard deviation of a stiffness from a data sheet (the coupling's)."""
ASSUMED_TOLERANCE = 0.3
"""Relative standard deviation of a stiffness that nobody has stated (bearing, nut, screw core)."""


def in_series(springs_n_per_m: Sequence[Quantity]) -> Quantity:
    """Stiffness of springs in series with its tolerance, N/m: K = 1 / sum(1 / K_i) (5.3.1).

    With independent relative tolerances t_i that of the sum is sqrt(sum((K / K_i t_i)^2)): soft
    springs weigh most, by value and by doubt. In the thesis' examples (5.3.3-5.3.5) four springs of
    1000 N/m (printed "NM") give 250; one of them doubled gives 285.7 (+14 %), halved 200, which is
    a loss of 20 % and not, as printed, an increase, ten times stiffer +29 %, ten times softer -69 %
    (printed 70 %).

    Raises:
        ValueError: there is no spring, or one is not greater than 0.

    >>> sum_of_four = in_series([Quantity(value=1000.0, tolerance=0.1)] * 4)
    >>> round(sum_of_four.value, 6), round(sum_of_four.tolerance, 6)
    (250.0, 0.05)
    """
    if not springs_n_per_m:
        raise ValueError("springs_n_per_m: expected at least one spring")
    for spring in springs_n_per_m:
        require_positive(stiffness_n_per_m=spring.value)
    stiffness = 1.0 / math.fsum(1.0 / spring.value for spring in springs_n_per_m)
    doubts = (stiffness / spring.value * spring.tolerance for spring in springs_n_per_m)
    return Quantity(value=stiffness, tolerance=math.hypot(*doubts))


def preload_from_nut_stiffness(stiffness_n_per_m: float, catalogue_n_per_m: float) -> float:
    """Preload that gives a nut its stiffness, percent of the load rating: (5.3.11) solved for F_a.

    10 (K_n / (0.8 K))^3: a relative deviation of either stiffness counts three times. An answer
    at or below `LEAST_NUT_LOAD_PERCENT` means "that or less": there the stiffness stays.

    Raises:
        ValueError: a stiffness is not greater than 0.

    >>> round(preload_from_nut_stiffness(1.28e8, 1.6e8), 6)
    10.0
    """
    require_positive(stiffness_n_per_m=stiffness_n_per_m, catalogue_n_per_m=catalogue_n_per_m)
    share = stiffness_n_per_m / (NUT_MODEL_FACTOR * catalogue_n_per_m)
    return max(CATALOGUE_PRELOAD_PERCENT * share**3, LEAST_NUT_LOAD_PERCENT)


def preloaded_nut(catalogue_n_per_m: Quantity, preload_percent: Quantity) -> Quantity:
    """Stiffness of a nut under preload with its tolerance, N/m (5.3.11).

    A third of the preload's relative tolerance counts, by the cube root.

    Raises:
        ValueError: the catalogue stiffness is not greater than 0.

    >>> preload_percent = Quantity(value=10.0, tolerance=0.3)
    >>> nut = preloaded_nut(Quantity(value=1.6e8, tolerance=0.0), preload_percent)
    >>> round(nut.value / 1e8, 3), round(nut.tolerance, 3)
    (1.28, 0.1)
    """
    require_positive(catalogue_n_per_m=catalogue_n_per_m.value)
    return Quantity(
        value=nut_stiffness(catalogue_n_per_m.value, preload_percent.value),
        tolerance=math.hypot(catalogue_n_per_m.tolerance, preload_percent.tolerance / 3.0),
    )


@dataclass(frozen=True, slots=True)
class AxialSprings:
    """The springs of (5.3.2), each with its tolerance.

    Attributes:
        coupling_nm_per_rad: torsional stiffness of the coupling.
        screw_rigidity_n: A E of (5.3.9).
        screw_length_m: L of (5.3.10), between the bearings.
        bearing_arrangement: both ends are held axially, or the first only.
        bearing_n_per_m: one fixed bearing in series with its support.
        nut_n_per_m: K_n of (5.3.11), at the preload of interest.
        ratio_m_per_rad: R_t of (4.3.5).
        torsional_rigidity_nm2: G I_p of the screw, which twists between coupling and nut; not in
            print, and left out unless given. For a steel screw of 20 mm it is 1240 N m^2, which at
            a distance of 0.3 m is as soft as the bench's coupling (`screw_torsional_rigidity`).
    """

    coupling_nm_per_rad: Quantity
    screw_rigidity_n: Quantity
    screw_length_m: float
    bearing_arrangement: Literal["fixed-free", "fixed-fixed"]
    bearing_n_per_m: Quantity
    nut_n_per_m: Quantity
    ratio_m_per_rad: float
    torsional_rigidity_nm2: Quantity | None = None

    def __post_init__(self) -> None:
        require_positive(
            coupling_nm_per_rad=self.coupling_nm_per_rad.value,
            screw_rigidity_n=self.screw_rigidity_n.value,
            screw_length_m=self.screw_length_m,
            bearing_n_per_m=self.bearing_n_per_m.value,
            nut_n_per_m=self.nut_n_per_m.value,
            ratio_m_per_rad=self.ratio_m_per_rad,
        )
        if self.torsional_rigidity_nm2 is not None:
            require_positive(torsional_rigidity_nm2=self.torsional_rigidity_nm2.value)


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessCurve:
    """Axial stiffness between motor and table along the stroke (the thesis' Figure 5.5).

    Attributes:
        position_m: distance of the nut from the fixed bearing, m, (n,).
        stiffness_n_per_m: (n,).
        sigma_n_per_m: standard deviation from the springs' tolerances, first order, (n,). The
            deviations of one curve go together: a soft bearing is soft at every position.
        shares: by name of the spring, its share of the compliance, (n,) each; they add up to 1.
    """

    position_m: Floats
    stiffness_n_per_m: Floats
    sigma_n_per_m: Floats
    shares: dict[str, Floats]


def springs_of(machine: Machine, preload_percent: Quantity) -> AxialSprings:
    """The springs of a machine file at a preload, completed by the thesis' test bench (Appendix A).

    What the file does not state has `DATA_SHEET_TOLERANCE` or `ASSUMED_TOLERANCE`.

    Raises:
        ValueError: the file states a nut stiffness, but not the preload that belongs to it.

    >>> bench = Machine.model_validate(
    ...     {"axis": {"lead_m": 0.02}, "model": {"inertia_kg_m2": 1.5e-3}}
    ... )
    >>> curve = series_stiffness(springs_of(bench, Quantity(value=6.8)), np.array([0.2, 0.8]))
    >>> (curve.stiffness_n_per_m / 1e6).round(1).tolist()
    [40.6, 29.5]
    """
    axis = machine.axis
    rigidity_n = STEEL_MODULUS_PA * screw_area(axis.screw_diameter_m or SCREW_DIAMETER_M)
    return AxialSprings(
        coupling_nm_per_rad=Quantity(value=COUPLING_NM_PER_RAD, tolerance=DATA_SHEET_TOLERANCE),
        screw_rigidity_n=Quantity(value=rigidity_n, tolerance=ASSUMED_TOLERANCE),
        screw_length_m=max(axis.screw_length_m or SCREW_LENGTH_M, axis.stroke_m or 0.0),
        bearing_arrangement=axis.bearing_arrangement,
        bearing_n_per_m=Quantity(value=BEARING_N_PER_M, tolerance=ASSUMED_TOLERANCE),
        nut_n_per_m=preloaded_nut(_nut_catalogue(machine), preload_percent),
        ratio_m_per_rad=machine.transmission_ratio_m_per_rad,
    )


def _nut_catalogue(machine: Machine) -> Quantity:
    """K of (5.3.11), N/m."""
    nut, fresh_percent = machine.model.nut_stiffness_n_per_m, machine.fresh_preload_percent
    if nut is None:
        return Quantity(value=NUT_CATALOGUE_N_PER_M, tolerance=ASSUMED_TOLERANCE)
    if fresh_percent is None:
        raise ValueError(
            "model.nut_stiffness_n_per_m needs the preload: model.preload_n is missing"
        )
    catalogue = catalogue_nut_stiffness(nut.value, fresh_percent)
    return Quantity(value=catalogue, tolerance=nut.tolerance)


def series_stiffness(springs: AxialSprings, position_m: Floats) -> StiffnessCurve:
    """Stiffness at positions (n,), m from the fixed bearing (5.3.2, 5.3.9, 5.3.10).

    Each held end of the screw is a rod A E / a behind a bearing; two held ends act side by side.
    With rigid bearings that is (5.3.9) and (5.3.10). Coupling and twist act through R_t^2. A
    compliance is homogeneous in those of its springs, so the part of each is also its sensitivity:
    sigma_K / K = sqrt(sum((share_i t_i)^2)), the two bearings taken as alike.

    Raises:
        ValueError: a position is off the screw or not a number.

    >>> rigid = Quantity(value=1e15)
    >>> screw = AxialSprings(rigid, Quantity(value=6.4e7), 1.0, "fixed-fixed", rigid, rigid, 0.003)
    >>> curve = series_stiffness(screw, np.array([0.5]))
    >>> round(float(curve.stiffness_n_per_m[0]) / 1e8, 3)  # A E L / (a b) = 4 A E / L
    2.56
    """
    if not np.all((position_m >= 0.0) & (position_m <= springs.screw_length_m)):
        raise ValueError(
            f"position_m: expected 0 to {springs.screw_length_m:g} m, the length of the screw"
        )
    parts = _compliances(springs, position_m)
    total = np.sum([compliance for compliance, _ in parts.values()], axis=0)
    shares = {name: compliance / total for name, (compliance, _) in parts.items()}
    doubts = [shares[name] * tolerance for name, (_, tolerance) in parts.items()]
    spread = np.sqrt(np.sum(np.square(doubts), axis=0))
    return StiffnessCurve(position_m, 1.0 / total, spread / total, shares)


def _compliances(springs: AxialSprings, position_m: Floats) -> dict[str, tuple[Floats, float]]:
    """Part of each spring in the compliance, m/N, (n,), and its relative tolerance."""
    rigidity, bearing = springs.screw_rigidity_n.value, 1.0 / springs.bearing_n_per_m.value
    length, far = springs.screw_length_m, float(springs.bearing_arrangement == "fixed-fixed")
    held = np.array([screw_compliance(a, rigidity, length, far, bearing) for a in position_m])
    near = held / (bearing + position_m / rigidity)  # share of the load in each arm
    of_bearings = bearing * (near**2 + (1.0 - near) ** 2)
    through_screw = springs.ratio_m_per_rad**2
    coupling, nut = springs.coupling_nm_per_rad, springs.nut_n_per_m
    everywhere = np.ones_like(position_m)
    parts = {
        "coupling": (through_screw / coupling.value * everywhere, coupling.tolerance),
        "bearing": (of_bearings, springs.bearing_n_per_m.tolerance),
        "screw": (held - of_bearings, springs.screw_rigidity_n.tolerance),
        "nut": (everywhere / nut.value, nut.tolerance),
    }
    twist = springs.torsional_rigidity_nm2
    if twist is not None:
        parts["twist"] = (through_screw * position_m / twist.value, twist.tolerance)
    return parts
