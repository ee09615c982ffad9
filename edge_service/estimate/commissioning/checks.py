"""Refusal of recordings that leave a quantity undetermined or contradict the machine file.

A wrong number with a narrow interval is worse than none: every estimate rests on it.
"""

import numpy as np
from scipy.constants import g as gravity_m_s2

from ...checks.finding import looks_wrong
from ...checks.torque import INERTIA_FACTOR
from ...messages.samples import TORQUE
from ...models.commissioned import TransmissionConfig
from ...models.machine import Machine, Quantity
from .phases import CommissioningError, SteadyPhases
from .shares import SIGMAS, guide_drag, other_drag_nm
from .timing import SURE, torque_lag
from .torque_balance import TorqueBalance

UNEXPLAINED = 0.4
"""Share of the torque's rms that motion may leave unexplained."""
MOVE_SCATTER = 0.05
"""Scatter of friction from move to move over friction: a healthy axis has the same in all."""
LONGEST_LAG_S = 4e-3
"""Filters and cycles of drives delay torque by 0.3 to 2 ms."""
OTHER_FACTOR, STATED_FACTOR = 10.0, 2.0
"""Friction that may stand beside the screw's own where no weight is known, and over the stated."""
WORN_SHARE = 0.7
"""Share of the fresh screw's drag: a healthy screw, run in and cold, has more."""
SEALS_N = 200.0
"""Carriages with double seals and scrapers (catalogues: 5 to 50 N each), strips of light axes."""
BEARING_NM_PER_M = 11.0
"""Sealed thrust bearings by the screw's diameter (INA ZKLF: 0.015 N m a mm of bore, 3/4 of it)."""
NUT_SHARES = (0.03, 1.0)
"""Nut's share of the series compliance: screw, bearings and coupling are softer than nothing."""


def require_identified(
    phases: SteadyPhases, torque: TorqueBalance, doubt_kg_m2: float, machine: Machine
) -> None:
    """Require a torque balance that is determined, and is the one of this machine file.

    `doubt_kg_m2` is by how much the inertia differs between windows (timing.inertia_doubt).

    Raises:
        CommissioningError: it is not; the text names the finding and its remedy.
    """
    lag = torque_lag(phases)
    if lag is not None and abs(lag[0]) - SIGMAS * lag[1] > LONGEST_LAG_S:
        way = "later" if lag[0] > 0.0 else "earlier"
        raise CommissioningError(
            f"torque is {1e3 * abs(lag[0]):.2g} ms {way} than the acceleration it causes "
            f"(expected less than {1e3 * LONGEST_LAG_S:.2g}): needs columns.{TORQUE} unfiltered "
            "and sampled with the position"
        )
    found, stated = torque.inertia_kg_m2, machine.model.inertia_kg_m2
    if doubt_kg_m2 > SURE * found:
        raise CommissioningError(
            f"inertia changes with the window: {found:.3g} kg m2 from sample to sample, "
            f"{doubt_kg_m2:.2g} off over intervals (expected less than {100.0 * SURE:.0f} %): "
            "needs faster samples, a finer encoder, torque sampled with the position, or "
            "recordings without process forces"
        )
    apart = abs(found - stated.value) > SIGMAS * float(np.hypot(torque.inertia_sigma, stated.sigma))
    if apart and not _within(found, stated.value, INERTIA_FACTOR):
        raise CommissioningError(
            f"{looks_wrong('torque', found / stated.value)}: inertia reads {found:.3g} kg m2, not "
            f"{stated.value:.3g}: check model.inertia_kg_m2, axis.lead_m, columns.{TORQUE}.scale"
        )
    if torque.unexplained > UNEXPLAINED:
        raise CommissioningError(
            f"motion explains too little of the torque: {100.0 * torque.unexplained:.0f} % of it "
            f"is left (expected less than {100.0 * UNEXPLAINED:.0f}): needs recordings without "
            "process forces, or faster samples"
        )
    share = torque.move_scatter_nm / torque.coulomb_nm
    if share > MOVE_SCATTER:
        raise CommissioningError(
            f"friction differs from move to move by {100.0 * share:.2g} % (expected less than "
            f"{100.0 * MOVE_SCATTER:.0f}): needs recordings of one cold day, without "
            "process forces, such as the same program without a workpiece"
        )
    for name, value, sigma, motion in (
        ("inertia", torque.inertia_kg_m2, torque.inertia_sigma, "acceleration"),
        ("friction", torque.coulomb_nm, torque.coulomb_sigma, "friction"),
    ):
        if sigma > SURE * value:
            raise CommissioningError(
                f"{name} is known only to within {100.0 * sigma / value:.2g} % (expected "
                f"{100.0 * SURE:.0f}): needs longer recordings of `edge-service motion {motion}`, "
                "or faster samples"
            )


def _within(one: float, other: float, factor: float) -> bool:
    return other / factor <= one <= other * factor


def require_fresh_screw(
    torque: TorqueBalance, machine: Machine, transmission: TransmissionConfig | None
) -> None:
    """Require the friction of a fresh screw and of plausible guides and bearings.

    With two encoders the wind-up at reversals shows the guides' friction, and what is left must
    be the screw's and the bearings'.

    Raises:
        CommissioningError: it is not, so the screw is worn or warm, or a unit is another.
    """
    screw = machine.model.preload_drag_nm
    if screw is None or machine.model.preload_n is None:
        return
    guide = guide_drag(machine, transmission) or Quantity(value=0.0)
    whole = f"the axis shows {torque.coulomb_nm:.3g} N m of Coulomb friction"
    if screw.value > 1.1 * torque.coulomb_nm:
        raise CommissioningError(
            f"{whole}, less than the fresh screw's own {screw.value:.3g} N m "
            "(model.preload_drag_nm): not healthy, or wrong units"
        )
    bearing = machine.model.bearing_drag_nm
    left_nm = torque.coulomb_nm - guide.value - bearing.value
    sigma = float(np.sqrt(torque.coulomb_sigma**2 + guide.sigma**2 + bearing.sigma**2))
    if left_nm + SIGMAS * sigma < WORN_SHARE * screw.value:
        also = f" and {bearing.value:.3g} in the bearings" if bearing.value else ""
        raise CommissioningError(
            f"{whole}, of it {guide.value:.3g} in the guides{also}: the {left_nm:.3g} left is "
            f"less than the fresh screw's own {screw.value:.3g} N m (model.preload_drag_nm): "
            "worn or warm; needs a healthy, cold axis, or the right model.table_mass_kg"
        )


def require_stated_nut(machine: Machine, transmission: TransmissionConfig | None) -> None:
    """Require an axis that is softer than its nut alone, but not by far.

    Raises:
        CommissioningError: the stretch contradicts the nut's stiffness or the table's mass.
    """
    nut, mass = machine.model.nut_stiffness_n_per_m, machine.model.table_mass_kg
    if transmission is None or nut is None or mass is None:
        return
    stiffness = mass.value / transmission.stretch_per_acceleration_s2
    share, low, high = stiffness / nut.value, *NUT_SHARES
    doubt = 1.0 + SIGMAS * float(np.hypot(nut.tolerance, mass.tolerance))
    if low / doubt <= share <= high * doubt:
        return
    raise CommissioningError(
        f"the stretch shows a series stiffness of {stiffness:.3g} N/m, "
        f"{'more' if share > high else 'far less'} than the nut's own {nut.value:.3g} "
        "(model.nut_stiffness_n_per_m) allows: check it, model.table_mass_kg and the encoders"
    )


def require_light_guides(torque: TorqueBalance, machine: Machine) -> None:
    """Require friction that weight or seals, bearings and what the file states of guides explain.

    Raises:
        CommissioningError: another force brakes the axis all the time, or a unit is another.
    """
    model, ratio = machine.model, machine.transmission_ratio_m_per_rad
    mass, screw_nm = model.table_mass_kg, machine.fresh_drag_nm
    if mass is None and not screw_nm:
        return
    weight_n = OTHER_FACTOR * screw_nm / ratio
    if mass is not None:
        weight_n = gravity_m_s2 * mass.value * (1.0 + SIGMAS * mass.tolerance)
    bearing_nm = BEARING_NM_PER_M * (machine.axis.screw_diameter_m or 0.0)
    most_n = max(weight_n, SEALS_N, STATED_FACTOR * model.guide_force_n.value)
    most_n += max(bearing_nm, model.bearing_drag_nm.value) / ratio
    force_n = other_drag_nm(machine, torque) / ratio
    if force_n > most_n:
        raise CommissioningError(
            f"friction beside the screw's is {force_n:.3g} N, more than the table weighs and than "
            f"seals and bearings hold back ({most_n:.3g} N): needs recordings without process "
            "forces, the guides' own in model.guide_force_n, or the right model.table_mass_kg, "
            f"model.preload_drag_nm and scale of columns.{TORQUE}"
        )
