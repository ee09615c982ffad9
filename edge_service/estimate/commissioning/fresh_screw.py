"""Whether recordings show a fresh screw: what is left of the friction against the data sheet.

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
    which it is a quarter, by a twentieth.

    Args:
        nominal: the machine file before, with the data sheet's figures.
        learned: what came out.
    """
    screw, taught = nominal.model.preload_drag_nm, learned.commissioned
    if screw is None or taught is None or nominal.model.preload_n is None or not screw.value:
        return None
    stated_nm = taught.coulomb_nm - nominal.other_drag_nm.value
    sigma = math.hypot(learned.model.bearing_drag_nm.sigma, nominal.other_drag_nm.sigma)
    if _is_as_stated(stated_nm, sigma, screw):
        return None
    guide = guide_drag(nominal, taught.transmission)
    left_nm = stated_nm if guide is None else taught.coulomb_nm - guide.value
    said = (
        f"{left_nm:.3g} N m of friction is left for screw and bearings, and the data sheet's "
        f"fresh screw alone has {screw.value:.3g} (model.preload_drag_nm)"
    )
    if left_nm < screw.value:
        return Doubt(f"{said}: worn, warm, or part of its drag acts behind its spring", True)
    if guide is not None:
        return None
    words = (
        f"{said}: the rest may be guides and bearings, or hide a preload that is lost; state "
        "model.guide_force_n and model.bearing_drag_nm, or record a linear encoder and state "
        "model.table_mass_kg"
    )
    return Doubt(words, False)


def _is_as_stated(left_nm: float, sigma_nm: float, screw: Quantity) -> bool:
    """Tell whether the stated frictions, well enough known, leave the fresh screw's own."""
    reach_nm = SIGMAS * math.hypot(sigma_nm, screw.sigma)
    if reach_nm > SEEN_LOSS * screw.value:
        return False
    return -reach_nm <= left_nm - screw.value <= reach_nm + UNEXPLAINED_SHARE * screw.value


def guide_drag(machine: Machine, transmission: TransmissionConfig | None) -> Quantity | None:
    """Friction that the stretch shows at reversals, N m; None where no mass gives its size."""
    mass = machine.model.table_mass_kg
    if transmission is None or mass is None:
        return None
    stretch_sigma = transmission.stretch_sigma_s2 / transmission.stretch_per_acceleration_s2
    value = transmission.reversal_force_n * machine.transmission_ratio_m_per_rad
    return Quantity(value=value, tolerance=math.hypot(mass.tolerance, stretch_sigma))
