"""Any set of effects put into a plant: constants, tables, and what follows time."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ...messages.samples import Floats
from ..plant.tables import (
    COLUMNS,
    DRY_MOTOR,
    DRY_TABLE,
    MISREADING,
    NUT_SHIFT,
    SMOOTH_MOTOR,
    SMOOTH_TABLE,
    angle_grid,
    position_grid,
    speed_grid,
    stack,
)
from ..plant.two_mass import Loads, Plant
from .contribution import (
    HOLDING,
    Change,
    Constant,
    Contribution,
    Curve,
    DryFriction,
    LoadFriction,
    Over,
    Place,
    Play,
    Shift,
    Side,
    SmoothTorque,
    Strain,
    TableForce,
    ViscousFriction,
    Warming,
    constant,
)
from .effect import ActiveEffect

_Kind = TypeVar("_Kind", bound=Contribution)


@dataclass(frozen=True, slots=True)
class Forward:
    """A plant with effects, and what of them lies outside the plant."""

    plant: Plant
    contributions: tuple[Contribution, ...]
    drag_table_share: float
    command_per_torque: float  # over the torque that the motor gives
    torque_limit_nm: float  # beyond it the motor gives no more
    position_lag_s: float  # of the linear channel behind the others, in the record only

    def over_time(self, time_s: Floats, temperature_c: Floats) -> Loads:
        """Loads that follow time or temperature, at (n,) times since the beginning.

        Args:
            temperature_c: of the housing; NaN where unknown: then nothing follows it.
        """
        variable = {Over.TIME: time_s, Over.TEMPERATURE: temperature_c}

        def at(over: Over, curve: Curve) -> Floats:
            return np.asarray(np.nan_to_num(curve(variable[over]), nan=0.0))

        force, motor_dry, table_dry, viscous, resisting, strain = np.zeros((6, len(time_s)))
        for each in self.contributions:
            match each:
                case DryFriction(over, curve, side) if over in variable:
                    share = side.table_share(self.drag_table_share)
                    motor_dry += (1.0 - share) * at(over, curve)
                    table_dry += share * at(over, curve)
                case ViscousFriction(over, curve):
                    viscous += at(over, curve)
                case SmoothTorque(over, curve, side) if over in variable:
                    share = side.table_share(self.drag_table_share)
                    resisting += (1.0 - share) * at(over, curve)
                    force -= share * at(over, curve) / self.plant.ratio_m_per_rad
                case TableForce(curve):
                    force += curve(time_s)
                case Strain(over, curve):
                    strain += at(over, curve)
                case _:
                    pass
        return Loads(force, motor_dry, table_dry, viscous, resisting, strain)

    def temperature_rise_k(self, time_s: Floats) -> Floats:
        """Rise of the housing's sensor at (n,) times since the beginning, K; it acts on nothing."""
        rise = np.zeros(len(time_s))
        for each in _of(Warming, self.contributions):
            other = each.rise_k(time_s)
            rise = np.where(np.abs(other) > np.abs(rise), other, rise)
        return rise


def put_into(plant: Plant, effects: Sequence[ActiveEffect], screw_drag_nm: float) -> Forward:
    """The plant with all effects.

    Args:
        screw_drag_nm: of the fresh screw, for friction that is shared as the Coulomb level is.

    Raises ValueError: the effects leave no mass on the table.
    """
    parts = tuple(part for effect in effects for part in effect.contributions)
    guide_nm = plant.guide_force_n * plant.ratio_m_per_rad
    coulomb_nm = screw_drag_nm + plant.bearing_drag_nm + guide_nm
    share = guide_nm / coulomb_nm if coulomb_nm > 0.0 else 0.0
    dry_share, viscous_share = _shares_behind(plant, parts)
    viscous = viscous_share * plant.motor_viscous_nm_s_per_rad
    if viscous != 0.0:
        parts += (
            SmoothTorque(Over.SPEED, lambda speed: viscous * speed, Side.TABLE),
            SmoothTorque(Over.SPEED, lambda speed: -viscous * speed, Side.MOTOR),
        )
    if not guide_nm and any(each.friction_share for each in _of(Play, parts)):
        held_nm = HOLDING * coulomb_nm
        parts += (DryFriction(Over.SPEED, constant(held_nm), Side.TABLE),)
        parts += (DryFriction(Over.SPEED, constant(-held_nm), Side.MOTOR),)
    limits, speed = _changes(parts, Constant.TORQUE_LIMIT), speed_grid()
    tables = stack(
        _table(parts, Over.POSITION, position_grid(plant.screw_length_m), share),
        _table(parts, Over.ANGLE, angle_grid(), share),
        _table(parts, Over.SPEED, speed, share),
        _table(parts, Over.SPEED, -speed, share),
        plant.screw_length_m,
    )
    moved = _changed(_dry_friction_behind(plant, dry_share), parts)
    changed = _shared(moved._replace(tables=tables), screw_drag_nm)
    return Forward(
        plant=changed,
        contributions=parts,
        drag_table_share=share,
        command_per_torque=1.0 + sum(_changes(parts, Constant.COMMAND_SHARE)),
        torque_limit_nm=min(limits, default=np.inf),
        position_lag_s=sum(_changes(parts, Constant.POSITION_LAG)),
    )


def _shares_behind(plant: Plant, parts: Sequence[Contribution]) -> tuple[float, float]:
    """Shares of dry and viscous friction on the table as the effects state them, or the plant's."""
    stated = [(p.friction_share, p.viscous_share) for p in _of(LoadFriction, parts)]
    stated += [(p.friction_share, p.viscous_share) for p in _of(Play, parts)]
    middle_m = 0.5 * plant.screw_length_m
    load, coulomb_load, viscous_load = (
        sum(_changes(parts, even)) + middle_m * sum(_changes(parts, sloped))
        for even, sloped in (
            (Constant.COMPLIANCE, Constant.COMPLIANCE_SLOPE),
            (Constant.COULOMB_LOAD_COMPLIANCE, Constant.COULOMB_LOAD_COMPLIANCE_SLOPE),
            (Constant.VISCOUS_LOAD_COMPLIANCE, Constant.VISCOUS_LOAD_COMPLIANCE_SLOPE),
        )
    )
    if load != 0.0:
        stated.append((1.0 + coulomb_load / load, viscous_load / load))
    dry, viscous = np.mean(stated or [(1.0, 0.0)], axis=0)
    return float(dry), float(viscous)


def _dry_friction_behind(plant: Plant, share: float) -> Plant:
    moved_nm = (share - 1.0) * plant.guide_force_n * plant.ratio_m_per_rad
    moved_nm = min(moved_nm, plant.bearing_drag_nm)
    return plant._replace(
        guide_force_n=plant.guide_force_n + moved_nm / plant.ratio_m_per_rad,
        bearing_drag_nm=plant.bearing_drag_nm - moved_nm,
    )


def _changes(parts: Iterable[Contribution], quantity: Constant) -> list[float]:
    return [each.value for each in _of(Change, parts) if each.quantity is quantity]


def _of(kind: type[_Kind], parts: Iterable[Contribution]) -> list[_Kind]:
    return [each for each in parts if isinstance(each, kind)]


def _changed(plant: Plant, parts: Iterable[Contribution]) -> Plant:
    total = {quantity: sum(_changes(parts, quantity)) for quantity in Constant}
    mass = plant.table_mass_kg + total[Constant.TABLE_INERTIA] / plant.ratio_m_per_rad**2
    if mass <= 0.0:
        raise ValueError(f"effects: they leave a table of {mass:.3g} kg, expected more than 0")
    return plant._replace(
        table_mass_kg=mass,
        motor_viscous_nm_s_per_rad=plant.motor_viscous_nm_s_per_rad + total[Constant.VISCOUS],
        torque_lag_s=plant.torque_lag_s + total[Constant.TORQUE_LAG],
        backlash_m=plant.backlash_m + sum(play.width_m for play in _of(Play, parts)),
        further_compliance_m_per_n=plant.further_compliance_m_per_n + total[Constant.COMPLIANCE],
        compliance_slope_per_n=plant.compliance_slope_per_n + total[Constant.COMPLIANCE_SLOPE],
        bristle_reach_m=plant.bristle_reach_m + total[Constant.PRESLIDING_REACH],
        load_friction=plant.load_friction + sum(p.coefficient for p in _of(LoadFriction, parts)),
    )


def _shared(plant: Plant, screw_drag_nm: float) -> Plant:
    """The plant with so much of the guides' friction on the motor as effects take away there.

    How dry friction is shared is an assumption where a machine file states one level for all of it:
    where one side has less than an effect takes, the whole would lose less than it should.
    """
    tables, least_nm = plant.tables, 0.0
    ends = np.cumsum((tables.position_points, tables.angle_points, 2 * tables.speed_points))
    for part in np.split(tables.rows[:, DRY_MOTOR], ends)[: len(ends)]:
        least_nm += min(float(part.min(initial=0.0)), 0.0)
    lacking_nm = -(least_nm + screw_drag_nm + plant.bearing_drag_nm)
    moved_nm = min(max(lacking_nm, 0.0), plant.guide_force_n * plant.ratio_m_per_rad)
    return plant._replace(
        bearing_drag_nm=plant.bearing_drag_nm + moved_nm,
        guide_force_n=plant.guide_force_n - moved_nm / plant.ratio_m_per_rad,
    )


def _table(parts: Sequence[Contribution], over: Over, grid: Floats, drag_share: float) -> Floats:
    """Columns of `tables` over a grid, (n, COLUMNS); (0, COLUMNS) where nothing is over it."""
    table, filled = np.zeros((len(grid), COLUMNS)), False
    for each in parts:
        match each:
            case DryFriction(found, curve, side) if found is over:
                share = side.table_share(drag_share)
                columns = {DRY_MOTOR: 1.0 - share, DRY_TABLE: share}
            case SmoothTorque(found, curve, side) if found is over:
                share = side.table_share(drag_share)
                columns = {SMOOTH_MOTOR: 1.0 - share, SMOOTH_TABLE: share}
            case Shift(place, found, curve) if found is over:
                columns = {NUT_SHIFT if place is Place.NUT else MISREADING: 1.0}
            case _:
                continue
        filled = True
        for column, weight in columns.items():
            table[:, column] += weight * curve(grid)
    return table if filled else table[:0]
