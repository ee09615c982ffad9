"""The thesis' component model (Figure 5.14): shaft, lead screw, friction and platform in a chain.

Torque on the shaft's input -> flexible shaft -> lead screw -> translational friction -> platform,
with a disturbance force on the platform. An adaptive stiff solver runs it: slow, with an error that
the solver controls, and without a line of code in common with the fast plant that it checks.

The shaft is one element, as Simscape's is by default: half of its inertia at each end. The lead
screw is ideal, all friction is (5.3.12) on the platform; `screw_friction` adds what the print has
not, drag of the screw and its bearings before the spring.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from edge_service.messages.samples import Floats
from edge_service.models.bounds import require_not_negative, require_positive
from tests.bench.oracles.linear_drive import INPUTS, OUTPUTS
from tests.bench.oracles.state_space import LinearModel

from .printed_friction import DirectionalFriction, Friction

SHAFT_ANGLE = 0  # rad, at the shaft's input: the rotary encoder
SHAFT_SPEED = 1  # rad/s
TABLE_POSITION = 2  # m: the linear encoder
TABLE_SPEED = 3  # m/s
STATE_SIZE = 4

ABSOLUTE_TOLERANCES = (1e-9, 1e-7, 1e-12, 1e-10)
"""Of the solver, per state: rad, rad/s, m, m/s; a thousandth of what the encoders resolve."""
RELATIVE_TOLERANCE = 1e-8


@dataclass(frozen=True, slots=True)
class ComponentDrive:
    """Constants of the blocks in Figure 5.14.

    Attributes:
        motor_inertia_kg_m2: at the shaft's input, rotor and coupling.
        shaft_inertia_kg_m2: of the flexible shaft, half at each end.
        shaft_stiffness_nm_per_rad: all springs of the drive as one torsion, K R_t^2.
        shaft_damping_nm_s_per_rad: parallel to it.
        ratio_m_per_rad: R_t of the lead screw (4.3.5).
        platform_mass_kg: table with its load.
        friction: of the platform (5.3.12).
        screw_friction: before the spring, as force and speed of a table that moved with the shaft.

    >>> contact = Friction(60.0, 60.0, 1e-3, 1e-4)
    >>> drive = ComponentDrive(1.2e-3, 1e-4, 400.0, 0.01, 3.183e-3, 20.0, contact)
    >>> drive.derivative(np.zeros(4), torque_nm=1.25, force_n=0.0).round(6).tolist()
    [0.0, 1000.0, 0.0, 0.0]
    """

    motor_inertia_kg_m2: float
    shaft_inertia_kg_m2: float
    shaft_stiffness_nm_per_rad: float
    shaft_damping_nm_s_per_rad: float
    ratio_m_per_rad: float
    platform_mass_kg: float
    friction: Friction | DirectionalFriction
    screw_friction: Friction | DirectionalFriction | None = None

    def __post_init__(self) -> None:
        require_positive(
            motor_inertia_kg_m2=self.motor_inertia_kg_m2,
            shaft_stiffness_nm_per_rad=self.shaft_stiffness_nm_per_rad,
            ratio_m_per_rad=self.ratio_m_per_rad,
            platform_mass_kg=self.platform_mass_kg,
        )
        require_not_negative(
            shaft_inertia_kg_m2=self.shaft_inertia_kg_m2,
            shaft_damping_nm_s_per_rad=self.shaft_damping_nm_s_per_rad,
        )

    @property
    def input_inertia_kg_m2(self) -> float:
        """Inertia turning with the rotary encoder, kg m^2."""
        return self.motor_inertia_kg_m2 + 0.5 * self.shaft_inertia_kg_m2

    @property
    def moved_mass_kg(self) -> float:
        """Mass moving with the linear encoder, kg: platform, and the shaft's end through R_t."""
        return self.platform_mass_kg + 0.5 * self.shaft_inertia_kg_m2 / self.ratio_m_per_rad**2

    def derivative(self, state: Floats, torque_nm: float, force_n: float) -> Floats:
        """Time derivative of the state (STATE_SIZE,), the right-hand side for `solve_ivp`.

        With the twist e = theta - x / R_t of the shaft::

            J theta'' = u - k e - d e' - R_t F_s(R_t theta')
            M x''     = F + (k e + d e') / R_t - F_r(x')           (5.3.12)
        """
        angle, speed, position_m, table_m_s = state
        ratio = self.ratio_m_per_rad
        held_nm = self.shaft_stiffness_nm_per_rad * (angle - position_m / ratio)
        held_nm += self.shaft_damping_nm_s_per_rad * (speed - table_m_s / ratio)
        shaft_nm = torque_nm - held_nm
        if self.screw_friction is not None:
            shaft_nm -= ratio * self.screw_friction.force_n(ratio * speed)
        table_n = force_n + held_nm / ratio - self.friction.force_n(table_m_s)
        return np.array(
            [speed, shaft_nm / self.input_inertia_kg_m2, table_m_s, table_n / self.moved_mass_kg]
        )

    def jacobian(self, state: Floats) -> Floats:
        """Derivative of `derivative` by the state, (STATE_SIZE, STATE_SIZE)."""
        ratio, inertia, mass = self.ratio_m_per_rad, self.input_inertia_kg_m2, self.moved_mass_kg
        k, d = self.shaft_stiffness_nm_per_rad, self.shaft_damping_nm_s_per_rad
        before = 0.0
        if self.screw_friction is not None:
            slope = self.screw_friction.slope_n_s_per_m(ratio * state[SHAFT_SPEED])
            before = ratio**2 * float(slope)
        after = float(self.friction.slope_n_s_per_m(state[TABLE_SPEED]))
        on_shaft = np.array([-k, -(d + before), k / ratio, d / ratio]) / inertia
        on_table = np.array([k, d, -k / ratio, -d / ratio - ratio * after]) / (ratio * mass)
        return np.array([[0.0, 1.0, 0.0, 0.0], on_shaft, [0.0, 0.0, 0.0, 1.0], on_table])

    def linearised(self, shaft_speed_rad_s: float, table_speed_m_s: float) -> LinearModel:
        """The model for small deviations from a steady motion (5.3.21), states as here.

        The thesis' "Taylor series approximation" of the friction, good near one speed only. On the
        falling side of the Stribeck peak it may be unstable, as the axis then is.
        """
        return LinearModel(
            state_matrix=self.jacobian(np.array([0.0, shaft_speed_rad_s, 0.0, table_speed_m_s])),
            input_matrix=np.array(
                [
                    [0.0, 0.0],
                    [1.0 / self.input_inertia_kg_m2, 0.0],
                    [0.0, 0.0],
                    [0.0, 1.0 / self.moved_mass_kg],
                ]
            ),
            output_matrix=np.eye(STATE_SIZE),
            feedthrough=np.zeros((STATE_SIZE, 2)),
            inputs=INPUTS,
            outputs=OUTPUTS,
        )


@dataclass(frozen=True, slots=True, eq=False)
class ComponentRun:
    """The four outputs of Figure 5.14, without sensor noise.

    Attributes:
        time_s: (n,).
        motor_angle_rad, motor_speed_rad_s: at the shaft's input, (n,).
        table_position_m, table_speed_m_s: of the platform, (n,).
    """

    time_s: Floats
    motor_angle_rad: Floats
    motor_speed_rad_s: Floats
    table_position_m: Floats
    table_speed_m_s: Floats


def simulate(
    drive: ComponentDrive,
    time_s: Floats,
    torque_nm: Floats,
    force_n: Floats,
    start: Floats | None = None,
) -> ComponentRun:
    """Run the model of Figure 5.14 from the state `start` (STATE_SIZE,), or from rest at zero.

    The inputs (n,) at increasing times (n,) are held until the next one; the solver is started
    anew where one changes, so that it never steps over an edge. It keeps each state within
    `RELATIVE_TOLERANCE` and `ABSOLUTE_TOLERANCES` per step (Radau IIA, order 5).

    Raises:
        ValueError: a shape does not fit, a value is not finite or the times do not increase.
        ArithmeticError: the solver gives up.

    >>> contact = Friction(60.0, 60.0, 1e-3, 1e-4)
    >>> drive = ComponentDrive(1.2e-3, 1e-4, 400.0, 0.01, 3.183e-3, 20.0, contact)
    >>> time_s = np.linspace(0.0, 0.1, 11)
    >>> run = simulate(drive, time_s, np.full(11, 1.0), np.zeros(11))
    >>> gain = (1.0 - 60.0 * 3.183e-3) / (1.25e-3 + drive.moved_mass_kg * 3.183e-3**2)
    >>> round(float(run.motor_speed_rad_s[-1]) / (0.1 * gain), 2)
    1.0
    """
    first = np.zeros(STATE_SIZE) if start is None else start
    _check_inputs(time_s, torque_nm, force_n, first)
    states = np.empty((len(time_s), STATE_SIZE))
    states[0] = first
    changes = (np.diff(torque_nm[:-1]) != 0.0) | (np.diff(force_n[:-1]) != 0.0)
    edges = [0, *(np.flatnonzero(changes) + 1), len(time_s) - 1]
    for begin, end in itertools.pairwise(edges):
        states[begin + 1 : end + 1] = _hold(
            drive,
            time_s[begin : end + 1],
            float(torque_nm[begin]),
            float(force_n[begin]),
            states[begin],
        )
    return ComponentRun(time_s, *states.T)


def _hold(
    drive: ComponentDrive, time_s: Floats, torque_nm: float, force_n: float, first: Floats
) -> Floats:
    """States (n - 1, STATE_SIZE) after the first of the times (n,) under constant inputs."""
    solution = solve_ivp(
        lambda _, state: drive.derivative(state, torque_nm, force_n),
        (time_s[0], time_s[-1]),
        first,
        method="Radau",
        t_eval=time_s[1:],
        jac=lambda _, state: drive.jacobian(state),
        rtol=RELATIVE_TOLERANCE,
        atol=ABSOLUTE_TOLERANCES,
    )
    if not solution.success:
        raise ArithmeticError(f"the solver gave up after {time_s[0]:g} s: {solution.message}")
    return np.asarray(solution.y.T)


def _check_inputs(time_s: Floats, torque_nm: Floats, force_n: Floats, start: Floats) -> None:
    count = len(time_s)
    if count < 2 or not np.all(np.diff(time_s) > 0.0):
        raise ValueError("time_s: expected at least two times, increasing")
    for name, values, shape in (
        ("time_s", time_s, (count,)),
        ("torque_nm", torque_nm, (count,)),
        ("force_n", force_n, (count,)),
        ("start", start, (STATE_SIZE,)),
    ):
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"{name}: expected finite numbers of shape {shape}")
