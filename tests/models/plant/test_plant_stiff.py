"""Many effects at once against an adaptive stiff solver and against the balance of energy.

The reference is written from the sources of the effects and shares no code with the plant: friction
is a bristle with a state of its own (Dupont et al., 2002), its levels are the formulas.
"""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from edge_service.messages.samples import Floats
from edge_service.models.effects.forward import Forward, put_into
from edge_service.models.effects.registry import parse_effect
from edge_service.models.machine import Machine
from edge_service.models.plant import two_mass
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import Load, advance_plant, axial_compliance

START_M, PERCENT = 0.4, 6.8
SCREW_NM, BEARING_NM, GUIDE_N = 0.146, 0.05, 60.0
EFFECTS = (
    "stribeck:excess_nm=0.1,speed_rad_s=4.0",
    "backlash:width_m=1e-5",
    "presliding:reach_m=2e-5",
    "compliance:level_m_per_n=2e-8",
    "position_friction:excess_nm=0.1,centre_m=0.41,width_m=0.02",
    "load_offset:constant_nm=0.05,asymmetry_nm=0.03",
)
ARRANGEMENTS = ("fixed-free", "fixed-fixed")
PERIOD_S, PERIODS = 1e-3, 270


@dataclass(frozen=True)
class Axis:
    """The plant, and the same numbers by hand."""

    forward: Forward
    ratio: float
    motor_kg: float
    table_kg: float
    viscous: float
    damping: float
    compliance: float

    def levels_n(self, travel_m: float, speed_m_s: float) -> tuple[float, float, float, float]:
        """Dry friction of motor forwards, backwards, table forwards, backwards, N."""
        ratio = self.ratio
        coulomb_nm = SCREW_NM + BEARING_NM + GUIDE_N * ratio
        on_table = GUIDE_N * ratio / coulomb_nm
        stribeck = 0.1 * math.exp(-((speed_m_s / ratio / 4.0) ** 2))
        bump = 0.1 * math.exp(-4.0 * math.log(2.0) * ((travel_m - 0.41) / 0.02) ** 2)
        motor, table = SCREW_NM + BEARING_NM + stribeck, GUIDE_N * ratio + bump
        lopsided = np.array([1.0, -1.0]) * 0.03
        ahead, back = motor + (1.0 - on_table) * lopsided
        table_ahead, table_back = table + on_table * lopsided
        return ahead / ratio, back / ratio, table_ahead / ratio, table_back / ratio

    def rate(self, state: Floats, torque_nm: float) -> list[float]:
        """Of x1, v1, x2, v2 and of the two friction forces."""
        x1, v1, x2, v2, f1, f2 = state
        stretch = x1 - x2
        if stretch <= 0.0:  # the forward flank is at 0, the other a clearance behind
            stretch = min(stretch + 1e-5, 0.0)
        carried = 0.0
        if stretch != 0.0:
            carried = stretch / self.compliance + self.damping * (v1 - v2)
        ahead, back, table_ahead, table_back = self.levels_n(x1, v1)
        held1, held2 = min(max(f1, -back), ahead), min(max(f2, -table_back), table_ahead)
        motor_n = torque_nm / self.ratio - carried - held1 - self.viscous * v1
        table_n = carried - held2 - 0.05 / self.ratio
        return [
            v1,
            motor_n / self.motor_kg,
            v2,
            table_n / self.table_kg,
            bristle(held1, ahead, back, v1) * v1 + (held1 - f1) / 1e-6,
            bristle(held2, table_ahead, table_back, v2) * v2 + (held2 - f2) / 1e-6,
        ]


def bristle(held_n: float, ahead_n: float, back_n: float, speed: float) -> float:
    """Stiffness, N/m: elastic up to half of the level, falling to nothing at the level."""
    level, loaded = (ahead_n, held_n) if speed >= 0.0 else (back_n, -held_n)
    if loaded <= 0.5 * level:
        return level / 2e-5
    return level * max(level - loaded, 0.0) / (0.5 * level) / 2e-5


def axis_of(machine: Machine, arrangement: str) -> Axis:
    arranged = machine.axis.model_copy(update={"bearing_arrangement": arrangement})
    plant = plant_of(machine.model_copy(update={"axis": arranged}))
    plant = plant._replace(bearing_drag_nm=BEARING_NM, guide_force_n=GUIDE_N)
    ratio = plant.ratio_m_per_rad
    return Axis(
        put_into(plant, [parse_effect(text) for text in EFFECTS], SCREW_NM),
        ratio,
        plant.motor_inertia_kg_m2 / ratio**2,
        plant.table_mass_kg,
        plant.motor_viscous_nm_s_per_rad / ratio**2,
        plant.damping_n_s_per_m,
        axial_compliance(plant, START_M, PERCENT) + 2e-8,
    )


def torque_nm(period: int) -> float:
    """Forwards, to rest and back: two cycles of 7.5 Hz."""
    return 1.3 * math.sin(2.0 * math.pi * 7.5 * period * PERIOD_S)


def advance(axis: Axis, substeps: int) -> Floats:
    """States after each of the steps, (n, STATE_SIZE)."""
    plant, state = axis.forward.plant, np.zeros(two_mass.STATE_SIZE)
    state[[two_mass.MOTOR_TRAVEL, two_mass.TABLE_POSITION]] = START_M
    by_time = axis.forward.over_time(np.zeros(1), np.full(1, 20.0))
    states = [state.copy()]
    for period in range(PERIODS):
        load = Load(
            torque_nm(period),
            float(by_time.force_n[0]),
            SCREW_NM,
            axial_compliance(plant, START_M, PERCENT),
        )
        for _ in range(substeps):
            advance_plant(plant, state, load, PERIOD_S / substeps, 1)
            states.append(state.copy())
    return np.array(states)


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_many_effects_agree_with_a_stiff_solver(machine: Machine, arrangement: str) -> None:
    axis = axis_of(machine, arrangement)
    state = np.array([START_M, 0.0, START_M, 0.0, 0.0, 0.0])
    expected = [state]
    for period in range(PERIODS):
        held_nm = torque_nm(period)
        solution = solve_ivp(
            lambda _, s, held_nm=held_nm: axis.rate(s, held_nm),
            (0.0, PERIOD_S),
            state,
            method="LSODA",
            rtol=1e-8,
            atol=[1e-11, 1e-9, 1e-11, 1e-9, 1e-4, 1e-4],
        )
        assert solution.success
        state = solution.y[:, -1]
        expected.append(state)
    reference = np.array(expected)
    travel_m = float(np.ptp(reference[:, 0]))
    errors_m = [
        float(np.max(np.abs(advance(axis, n)[::n, :3:2] - reference[:, :3:2]))) for n in (16, 64)
    ]
    assert travel_m > 3e-3
    assert errors_m[0] < 2e-3 * travel_m
    assert errors_m[1] < errors_m[0] / 2.5


@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_work_is_kept_or_turned_to_heat_with_effects(machine: Machine, arrangement: str) -> None:
    """Energy is lost where a flank of the play touches within a step: less with each step."""
    axis = axis_of(machine, arrangement)
    lost = []
    for substeps in (16, 256):
        states = advance(axis, substeps)
        h = PERIOD_S / substeps
        travel = np.diff(states[:, [two_mass.MOTOR_TRAVEL, two_mass.TABLE_POSITION]], axis=0)
        given_nm = np.repeat([torque_nm(period) for period in range(PERIODS)], substeps)
        stretch = states[:, two_mass.MOTOR_TRAVEL] - states[:, two_mass.TABLE_POSITION]
        stretch = np.where(stretch > 0.0, stretch, np.minimum(stretch + 1e-5, 0.0))
        stored = 0.5 * stretch**2 / axis.compliance
        stored += 0.5 * axis.motor_kg * states[:, two_mass.MOTOR_SPEED] ** 2
        stored += 0.5 * axis.table_kg * states[:, two_mass.TABLE_SPEED] ** 2
        touching = stretch[:-1] != 0.0
        slip = travel[:, 0] - travel[:, 1]
        heat = (
            states[1:, two_mass.MOTOR_FRICTION] @ travel[:, 0]
            + states[1:, two_mass.TABLE_FRICTION] @ travel[:, 1]
        )
        heat += axis.viscous * float(np.sum(travel[:, 0] ** 2)) / h
        heat += axis.damping * float(np.sum(touching * slip**2)) / h
        put_in = given_nm / axis.ratio * travel[:, 0] - 0.05 / axis.ratio * travel[:, 1]
        gross = float(np.sum(np.abs(put_in)))
        lost.append(abs(float(np.sum(put_in)) - (stored[-1] - stored[0] + heat)) / gross)
        assert heat > 0.2 * gross
    assert lost[0] < 2e-3
    assert lost[1] < lost[0] / 4.0
