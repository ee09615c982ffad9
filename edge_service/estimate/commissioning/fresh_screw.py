"""Judgement of a fresh screw by recordings: what is left of the friction against the data sheet.

Preload is read as a share of the fresh screw's, so a worn screw that is learned as fresh is never
seen again.
"""

import math
from dataclasses import dataclass

from ...models.commissioned import TransmissionConfig
from ...models.machine import Machine, Quantity

SIGMAS = 3.0
UNEXPLAINED_SHARE = 0.1
"""Of the fresh screw's drag: friction of nobody, which a loss of as much could hide behind."""
SEEN_LOSS = 0.5
"""Of the fresh screw's drag: a file that knows the other frictions less well tells nothing."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Reason why recordings do not show a fresh screw.

    Attributes:
        contradicts: the data sheet's figures speak against it; else they leave it open.
    """

    words: str
    contradicts: bool


def doubt_of_fresh_screw(nominal: Machine, learned: Machine) -> Doubt | None:
    """Reason why the learned recordings do not show a fresh screw; None where they do.

    The whole friction is what the machine file states of screw, guides and bearings. Or two
    encoders see the guides' friction, and what they leave is more than the fresh screw's own, for
    it holds the bearings' too; some of the screw's may act on the table's side and pass for the
    guides'. With one encoder the guides could be what a worn screw has lost. The stiffness cannot
    tell: a nut that lost half its preload is a fifth softer by the cube root law, and the axis, of
    which it is a quarter, by a twentieth. A file that knows all frictions, such as one that was
    commissioned before, leaves it open again where some of them is missing.

    Args:
        nominal: the machine file before, with the data sheet's figures.
        learned: what came out.
    """
    screw, taught = nominal.model.preload_drag_nm, learned.commissioned
    if screw is None or taught is None or nominal.model.preload_n is None or not screw.value:
        return None
    stated_nm = taught.coulomb_nm - nominal.other_drag_nm.value
    sigma = math.hypot(learned.model.bearing_drag_nm.sigma, nominal.other_drag_nm.sigma)
    reach_nm = SIGMAS * math.hypot(sigma, screw.sigma)
    is_known = reach_nm <= SEEN_LOSS * screw.value
    missing_nm = screw.value - stated_nm
    if is_known and -reach_nm - UNEXPLAINED_SHARE * screw.value <= missing_nm <= reach_nm:
        return _assumed_before(nominal)
    guide = guide_drag(nominal, taught.transmission)
    left_nm = stated_nm if guide is None else taught.coulomb_nm - guide.value
    said = (
        f"{left_nm:.3g} N m of friction is left for screw and bearings, and the data sheet's "
        f"fresh screw alone has {screw.value:.3g} (model.preload_drag_nm)"
    )
    if left_nm < screw.value:
        return Doubt(f"{said}: worn, warm, or part of its drag acts behind its spring", True)
    if guide is not None:
        is_less = is_known and missing_nm > reach_nm
        return _less_than_stated(missing_nm) if is_less else _assumed_before(nominal)
    words = (
        f"{said}: the rest may be guides and bearings, or hide a preload that is lost; state "
        "model.guide_force_n and model.bearing_drag_nm, or record a linear encoder and state "
        "model.table_mass_kg"
    )
    return Doubt(words, False)


def _assumed_before(nominal: Machine) -> Doubt | None:
    """Doubt that a file hands on whose frictions were learned from a screw assumed to be fresh."""
    if nominal.commissioned is None or not nominal.commissioned.assumed_fresh:
        return None
    return Doubt("the machine file was made on that assumption (commissioned.assumed_fresh)", False)


def _less_than_stated(missing_nm: float) -> Doubt:
    """Doubt that a file leaves which knows all frictions, as a commissioned one does."""
    words = (
        f"friction is {missing_nm:.3g} N m less than the machine file states for a fresh screw, "
        "guides and bearings together: worn, warm or newly lubricated"
    )
    return Doubt(words, False)


def guide_drag(machine: Machine, transmission: TransmissionConfig | None) -> Quantity | None:
    """Friction that the stretch shows at reversals, N m; None where no mass gives its size."""
    mass = machine.model.table_mass_kg
    if transmission is None or mass is None:
        return None
    stretch_sigma = transmission.stretch_sigma_s2 / transmission.stretch_per_acceleration_s2
    value = transmission.reversal_force_n * machine.transmission_ratio_m_per_rad
    return Quantity(value=value, tolerance=math.hypot(mass.tolerance, stretch_sigma))
