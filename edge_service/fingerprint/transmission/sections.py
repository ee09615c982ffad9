"""Stiffness, lost motion, modes and preload as sections of a fingerprint."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...messages.samples import SampleFrame
from ...models.machine import Machine, Quantity
from ...regression.interval_estimate import IntervalEstimate, normal_quantile, undetermined
from ...regression.prepared_run import PreparedRun
from ..response.frequency_response import (
    FrequencyResponse,
    drive_response,
    drive_responses_along,
)
from ..response.two_mass_fit import fit_two_mass, modes
from ..result import Contents, Curve
from .nut_preload import preload_from_stiffness
from .stiffness_fit import StiffnessFit, fit_stiffness
from .stiffness_point import backlash

STROKE_SHARES = (0.2, 0.5, 0.8)
SHAKEN_HZ = 50.0
"""No everyday motion moves an axis coherently above this."""
LEAST_SHAKEN = 75
"""Coherent frequencies above SHAKEN_HZ that make a recording a test of the response."""
LOWEST_HZ = 5.0
DRAG_FACTOR_TOLERANCE = 0.1
"""Drag of one preload differs by 20 % between screws (Table A.1), taken as two deviations."""


def stiffness_places(machine: Machine) -> tuple[float, ...]:
    """Places along the stroke at which fingerprints can be compared, m.

    Raises:
        ValueError: the machine file has no stroke.
    """
    if machine.axis.stroke_m is None:
        raise ValueError("axis.stroke_m is missing in the machine file")
    return tuple(share * machine.axis.stroke_m for share in STROKE_SHARES)


def measure_stiffness(fit: StiffnessFit) -> Contents:
    """Stiffness and the table's resonance along the stroke."""
    figures: dict[str, IntervalEstimate] = {}
    for point in fit.points:
        place = f"at_{round(1000.0 * point.position_m)}_mm"
        figures[f"stiffness_{place}_n_per_m"] = point.stiffness
        figures[f"locked_resonance_{place}_hz"] = point.locked_resonance
    curve = Curve(
        "stiffness",
        np.array([point.position_m for point in fit.points]),
        np.array([point.stiffness.value for point in fit.points]),
        "table position, m",
        "stiffness, N/m",
    )
    return figures, (curve,)


def measure_backlash(fit: StiffnessFit, machine: Machine) -> Contents:
    """Lost motion along the stroke, and the play in it where the guide force is known."""
    known = "guide_force_n" in machine.model.model_fields_set
    guide_n = machine.model.guide_force_n if known else None
    figures: dict[str, IntervalEstimate] = {}
    for point in fit.points:
        place = f"at_{round(1000.0 * point.position_m)}_mm"
        figures[f"lost_motion_{place}_m"] = point.lost_motion
        figures[f"backlash_{place}_m"] = backlash(point, guide_n, fit.play)
    curve = Curve(
        "lost motion",
        np.array([point.position_m for point in fit.points]),
        np.array([point.lost_motion.value for point in fit.points]),
        "table position, m",
        "lost motion, m",
    )
    return figures, (curve,)


def stretch_fit(runs: Iterable[PreparedRun], machine: Machine) -> StiffnessFit:
    """Fit of the stretch between the encoders; raises ValueError as `fit_stiffness` does."""
    return fit_stiffness(runs, stiffness_places(machine), machine.model.table_mass_kg)


def measure_response(recordings: Sequence[SampleFrame]) -> Contents:
    """Response of the drive to its torque with the modes of two masses (5.3.19-5.3.21).

    Raises:
        ValueError: one line; no recording shakes the axis.
    """
    shaken = [frame for frame in recordings if shakes(frame)]
    if not shaken:
        raise ValueError(f"no recording moves the axis coherently above {SHAKEN_HZ:g} Hz")
    measured = drive_response(shaken).within(LOWEST_HZ, math.inf)
    fit = fit_two_mass(
        [place.within(LOWEST_HZ, math.inf) for place in drive_responses_along(shaken)]
    )
    figures = {
        **modes(fit),
        "response_inertia_kg_m2": fit.inertia,
        "torque_delay_s": fit.delay,
    }
    labels = ("frequency, Hz", "speed over torque, rad/(s N m)")
    frequency = measured.frequency_hz
    return figures, (
        Curve("measured", frequency, np.abs(measured.response), *labels),
        Curve("fit", frequency, np.abs(fit.response(frequency)), *labels),
    )


def measure_preload(
    coulomb: IntervalEstimate | None,
    stiffness: Mapping[str, IntervalEstimate],
    fresh_stiffness: Mapping[str, IntervalEstimate],
    machine: Machine,
) -> Contents:
    """Preload from the drag (4.3.6) and from the change of the stiffness (5.3.11)."""
    figures = {
        "preload_from_drag_n": preload_from_drag_level(coulomb, machine),
        "preload_from_stiffness_n": _from_stiffness(stiffness, fresh_stiffness, machine),
    }
    return figures, ()


def preload_from_drag_level(coulomb: IntervalEstimate | None, machine: Machine) -> IntervalEstimate:
    """Preload from the Coulomb level less what guides and bearings rub, N.

    The fresh screw's pair of drag and preload gives the ratio. Where the machine file does not say
    what else rubs, all of the level may be the screw's or none of it.
    """
    model = machine.model
    if coulomb is None or not coulomb.determined:
        return undetermined("N", "the Coulomb level is undetermined")
    if model.preload_n is None or not model.preload_drag_nm or not model.preload_drag_nm.value:
        return undetermined("N", "model.preload_n or model.preload_drag_nm is missing")
    newton_per_nm = model.preload_n.value / model.preload_drag_nm.value
    others = machine.other_drag_nm
    screw_nm = coulomb.value - others.value
    shares = (model.preload_n.tolerance, model.preload_drag_nm.tolerance, DRAG_FACTOR_TOLERANCE)
    sigma = newton_per_nm * math.hypot(coulomb.sigma, others.sigma, screw_nm * math.hypot(*shares))
    value, half = newton_per_nm * screw_nm, normal_quantile() * sigma
    found = IntervalEstimate(
        value, max(value - half, 0.0), max(value + half, 0.0), "N", coulomb.n_effective
    )
    if {"guide_force_n", "bearing_drag_nm"} & model.model_fields_set:
        return found
    note = "model.guide_force_n and bearing_drag_nm are unknown: an upper bound"
    return replace(found, low=0.0, note=note)


def _from_stiffness(
    now: Mapping[str, IntervalEstimate], fresh: Mapping[str, IntervalEstimate], machine: Machine
) -> IntervalEstimate:
    """At the place that the screw's own compliance disturbs least: the tightest interval."""
    model = machine.model
    if model.preload_n is None:
        return undetermined("N", "model.preload_n is missing")
    if not fresh:
        return undetermined("N", "needs the stored fingerprint of the fresh axis (--baseline)")
    preload_n: Quantity = model.preload_n
    found = [
        preload_from_stiffness(now[name], fresh[name], preload_n, model.nut_stiffness_n_per_m)
        for name in sorted(now.keys() & fresh.keys())
        if name.startswith("stiffness_")
    ]
    if not found:
        return undetermined("N", "the stiffness is undetermined")
    return min(found, key=lambda each: each.high - each.low)


def shakes(frame: SampleFrame) -> bool:
    """True if a recording moves the axis coherently at high frequencies: chirp or multisine."""
    try:
        response: FrequencyResponse = drive_response([frame])
    except ValueError:  # a channel is missing, or the run is too short
        return False
    return int(np.sum(response.within(SHAKEN_HZ, math.inf).coherence > 0.9)) >= LEAST_SHAKEN
