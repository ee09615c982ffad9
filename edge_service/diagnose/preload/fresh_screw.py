"""Fresh screw of a machine file: what its preload drags, and how much of the spring is its nut."""

from collections.abc import Mapping

from ...models.machine import Machine
from ...models.plant.from_machine import table_mass


def fresh_screw(machine: Machine) -> Mapping[str, float] | None:
    """Values of a loss of preload that are those of the fresh screw; None where it is not known."""
    percent, drag = machine.fresh_preload_percent, machine.model.preload_drag_nm
    if percent is None or drag is None or drag.value <= 0.0:
        return None
    return {
        "fresh_drag_nm": drag.value,
        "fresh_percent": percent,
        "fresh_nut_m_per_n": _nut_m_per_n(machine),
    }


def _nut_m_per_n(machine: Machine) -> float:
    """Compliance of the fresh nut; 0 where nothing is known of it."""
    stated = machine.model.nut_stiffness_n_per_m
    if stated is not None:
        return 1.0 / stated.value
    learned = None if machine.commissioned is None else machine.commissioned.transmission
    if learned is None:
        return 0.0
    return learned.nut_share * learned.stretch_per_acceleration_s2 / table_mass(machine)
