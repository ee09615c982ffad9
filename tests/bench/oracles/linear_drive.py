"""The thesis' linear feed drives: one mass, two masses, a chain (5.3.6-5.3.8, 5.3.16-5.3.21).

Inputs are the torque u at the motor and the force on the table, positive along x; (5.3.18) and
(5.3.21) have a disturbance d in their place, which is R_t times that force. The friction is viscous
only: a straight line through a curve, good near the speed at which it was drawn.
"""

from dataclasses import dataclass, replace

import numpy as np

from edge_service.messages import channels
from edge_service.messages.samples import Floats
from edge_service.models.bounds import require_not_negative, require_positive
from edge_service.models.plant.two_mass import Plant, axial_compliance

from .state_space import LinearModel, TransferFunction

INPUTS = (channels.TORQUE, channels.EXTERNAL_FORCE)
OUTPUTS = (channels.ANGLE, channels.MOTOR_SPEED, channels.TABLE_POSITION, channels.TABLE_SPEED)
"""Signals of every model of a drive, by the names of the trace's columns."""


@dataclass(frozen=True, slots=True)
class OneMassDrive:
    """All masses in one, without stiffness (the thesis' Figure 5.12b).

    Attributes:
        inertia_kg_m2: J, the whole drive at the motor.
        viscous_nm_s_per_rad: D, at the motor.
        ratio_m_per_rad: R_t of (4.3.5), table travel per radian.

    >>> drive = OneMassDrive(1.5e-3, 5e-3, 3.183e-3)
    >>> drive.transfer_function().denominator.tolist()
    [0.0015, 0.005, 0.0]
    """

    inertia_kg_m2: float
    viscous_nm_s_per_rad: float
    ratio_m_per_rad: float

    def __post_init__(self) -> None:
        require_positive(inertia_kg_m2=self.inertia_kg_m2, ratio_m_per_rad=self.ratio_m_per_rad)
        require_not_negative(viscous_nm_s_per_rad=self.viscous_nm_s_per_rad)

    def transfer_function(self) -> TransferFunction:
        """Motor angle over torque, rad/(N m): 1 / (J s^2 + D s) (5.3.16)."""
        return TransferFunction(
            np.array([1.0]), np.array([self.inertia_kg_m2, self.viscous_nm_s_per_rad, 0.0])
        )

    def z_transform(self, period_s: float) -> TransferFunction:
        """Motor angle over torque at samples, rad/(N m): (5.3.17), exact for a held torque.

        (b1 z + b2) / (z^2 - (1 + p) z + p) with p = exp(-D T / J); for D > 0
        b1 = (T - J (1 - p) / D) / D and b2 = (J (1 - p) / D - p T) / D. The print lacks b2 and the
        last term of the denominator: as it stands its poles are z = 0 and z = -a2 / a1, so it
        cannot both integrate (z = 1) and decay (z = p).

        Raises:
            ValueError: the period is not greater than 0.
        """
        return (
            self.state_space().sampled(period_s).transfer_function(channels.ANGLE, channels.TORQUE)
        )

    def state_space(self) -> LinearModel:
        """States [angle, speed]; inputs torque and force; outputs at both ends (4.3.4, 5.3.18).

        Both columns of B are over J. The print has J_m, the motor alone, beside a J in A: the
        lumped mass has one inertia only.
        """
        ratio, inertia = self.ratio_m_per_rad, self.inertia_kg_m2
        return LinearModel(
            state_matrix=np.array([[0.0, 1.0], [0.0, -self.viscous_nm_s_per_rad / inertia]]),
            input_matrix=np.array([[0.0, 0.0], [1.0 / inertia, ratio / inertia]]),
            output_matrix=np.array([[1.0, 0.0], [0.0, 1.0], [ratio, 0.0], [0.0, ratio]]),
            feedthrough=np.zeros((4, 2)),
            inputs=INPUTS,
            outputs=OUTPUTS,
        )


@dataclass(frozen=True, slots=True)
class TwoMassDrive:
    """Motor and table with a spring between, all seen at the motor (the thesis' Figure 5.12a).

    Attributes:
        motor_inertia_kg_m2: J_m, rotor, coupling and screw.
        table_inertia_kg_m2: J_fd, the table's mass times R_t^2.
        stiffness_nm_per_rad: K, the axial stiffness times R_t^2.
        damping_nm_s_per_rad: D_1, parallel to the spring.
        motor_viscous_nm_s_per_rad: D_2, between motor and ground.
        table_viscous_nm_s_per_rad: between table and ground; not in print.
        ratio_m_per_rad: R_t of (4.3.5), table travel per radian.

    >>> drive = TwoMassDrive(1.3e-3, 2e-4, 400.0, 0.0, 0.0, 0.0, 3.183e-3)
    >>> [round(mode.frequency_hz, 3) for mode in drive.state_space().resonances()]
    [241.774]
    >>> round(drive.resonance_rad_s / (2.0 * np.pi), 3)
    241.774
    """

    motor_inertia_kg_m2: float
    table_inertia_kg_m2: float
    stiffness_nm_per_rad: float
    damping_nm_s_per_rad: float
    motor_viscous_nm_s_per_rad: float
    table_viscous_nm_s_per_rad: float
    ratio_m_per_rad: float

    def __post_init__(self) -> None:
        require_positive(
            motor_inertia_kg_m2=self.motor_inertia_kg_m2,
            table_inertia_kg_m2=self.table_inertia_kg_m2,
            stiffness_nm_per_rad=self.stiffness_nm_per_rad,
            ratio_m_per_rad=self.ratio_m_per_rad,
        )
        require_not_negative(
            damping_nm_s_per_rad=self.damping_nm_s_per_rad,
            motor_viscous_nm_s_per_rad=self.motor_viscous_nm_s_per_rad,
            table_viscous_nm_s_per_rad=self.table_viscous_nm_s_per_rad,
        )

    @classmethod
    def of_plant(cls, plant: Plant, position_m: float, preload_percent: float) -> "TwoMassDrive":
        """Model of the plant around a position and preload when its dry friction is left out."""
        ratio = plant.ratio_m_per_rad
        return cls(
            motor_inertia_kg_m2=plant.motor_inertia_kg_m2,
            table_inertia_kg_m2=plant.table_mass_kg * ratio**2,
            stiffness_nm_per_rad=ratio**2 / axial_compliance(plant, position_m, preload_percent),
            damping_nm_s_per_rad=plant.damping_n_s_per_m * ratio**2,
            motor_viscous_nm_s_per_rad=plant.motor_viscous_nm_s_per_rad,
            table_viscous_nm_s_per_rad=plant.table_viscous_n_s_per_m * ratio**2,
            ratio_m_per_rad=ratio,
        )

    @property
    def resonance_rad_s(self) -> float:
        """Both masses free, without friction, rad/s: sqrt(K (1 / J_m + 1 / J_fd))."""
        softness = 1.0 / self.motor_inertia_kg_m2 + 1.0 / self.table_inertia_kg_m2
        return float(np.sqrt(self.stiffness_nm_per_rad * softness))

    @property
    def antiresonance_rad_s(self) -> float:
        """Table on the spring of a locked motor, rad/s: sqrt(K / J_fd), zero of angle / torque."""
        return float(np.sqrt(self.stiffness_nm_per_rad / self.table_inertia_kg_m2))

    def transfer_function(self) -> TransferFunction:
        """Table angle theta_2 = x / R_t over torque, rad/(N m) (5.3.19)::

            (D_1 s + K) / (J_m J_fd s^4 + (D_1 J_m + D_1 J_fd + D_2 J_fd + D_3 J_m) s^3
              + ((J_m + J_fd) K + D_1 D_2 + D_1 D_3 + D_2 D_3) s^2 + (D_2 + D_3) K s)

        with D_3 between table and ground. The print has (J_m + J_fd) s^4, which has not even the
        unit of its neighbours, and D_2 J_m s^3, which puts D_2 on the table, where (5.3.21) has it
        on the motor; k and K are one.
        """
        motor, table = self.motor_inertia_kg_m2, self.table_inertia_kg_m2
        stiffness, d1 = self.stiffness_nm_per_rad, self.damping_nm_s_per_rad
        d2, d3 = self.motor_viscous_nm_s_per_rad, self.table_viscous_nm_s_per_rad
        cubic = d1 * (motor + table) + d2 * table + d3 * motor
        square = (motor + table) * stiffness + d1 * (d2 + d3) + d2 * d3
        return TransferFunction(
            np.array([d1, stiffness]),
            np.array([motor * table, cubic, square, (d2 + d3) * stiffness, 0.0]),
        )

    def z_transform(self, period_s: float) -> TransferFunction:
        """Table angle over torque at samples, rad/(N m): (5.3.20), exact for a held torque.

        Four numerator and five denominator coefficients, with one pole at z = 1. The print has two
        and four: its last pole would be z = 0, and two zeros of the sampling are lost.

        Raises:
            ValueError: the period is not greater than 0.
        """
        sampled = self.state_space().sampled(period_s)
        travel = sampled.transfer_function(channels.TABLE_POSITION, channels.TORQUE)
        return replace(travel, numerator=travel.numerator / self.ratio_m_per_rad)

    def state_space(self) -> LinearModel:
        """States [theta_2, its speed, theta_1, its speed]; outputs at motor and table (5.3.21).

        The print has the states and their derivatives on the wrong sides, and the rows of B
        exchanged: the torque acts on the motor (fourth row, 1 / J_m) and the disturbance on the
        table (second row, 1 / J_fd).
        """
        motor, table = self.motor_inertia_kg_m2, self.table_inertia_kg_m2
        ratio = self.ratio_m_per_rad
        stiffness, d1 = self.stiffness_nm_per_rad, self.damping_nm_s_per_rad
        d2, d3 = self.motor_viscous_nm_s_per_rad, self.table_viscous_nm_s_per_rad
        on_table = np.array([-stiffness, -(d1 + d3), stiffness, d1]) / table
        on_motor = np.array([stiffness, d1, -stiffness, -(d1 + d2)]) / motor
        return LinearModel(
            state_matrix=np.array([[0.0, 1.0, 0.0, 0.0], on_table, [0.0, 0.0, 0.0, 1.0], on_motor]),
            input_matrix=np.array(
                [[0.0, 0.0], [0.0, ratio / table], [0.0, 0.0], [1.0 / motor, 0.0]]
            ),
            output_matrix=np.array(
                [
                    [0.0, 0.0, 1.0, 0.0],
                    [0.0, 0.0, 0.0, 1.0],
                    [ratio, 0.0, 0.0, 0.0],
                    [0.0, ratio, 0.0, 0.0],
                ]
            ),
            feedthrough=np.zeros((4, 2)),
            inputs=INPUTS,
            outputs=OUTPUTS,
        )


def mass_chain(
    masses_kg: Floats,
    springs_n_per_m: Floats,
    dampers_n_s_per_m: Floats | None = None,
    ground_n_s_per_m: Floats | None = None,
) -> LinearModel:
    """n masses in a row with springs between neighbours: (5.3.6-5.3.8) for any n.

    M x'' + C x' + K x = f. (5.3.6) and (5.3.7) are right in print. (5.3.8) is not: the first
    minor's factor is m_1 s^2 + k_1, the second minor ends in m_3 s^2 + k_2, and a_4 = 0, for a free
    chain has two poles at rest.

    Args:
        masses_kg: (n,).
        springs_n_per_m: spring i between masses i and i + 1, (n - 1,).
        dampers_n_s_per_m: parallel to the springs, (n - 1,); none unless given.
        ground_n_s_per_m: between each mass and ground, (n,); none unless given.

    Returns:
        Model with states [positions, speeds], inputs `force_1` ... `force_n`, N, and outputs
        `position_1` ..., m, and `speed_1` ..., m/s.

    Raises:
        ValueError: a shape does not fit, a mass is not greater than 0, or a constant is negative.

    >>> chain = mass_chain(np.array([1.0, 1.0, 1.0]), np.array([1.0, 1.0]))
    >>> [round(mode.frequency_hz * 2.0 * np.pi, 6) for mode in chain.resonances()]
    [1.0, 1.732051]
    """
    count = len(masses_kg)
    dampers = np.zeros(max(count - 1, 0)) if dampers_n_s_per_m is None else dampers_n_s_per_m
    ground = np.zeros(count) if ground_n_s_per_m is None else ground_n_s_per_m
    _check_chain(masses_kg, springs_n_per_m, dampers, ground)
    stiffness = _between_neighbours(springs_n_per_m)
    damping = _between_neighbours(dampers) + np.diag(ground)
    mobility = np.diag(1.0 / masses_kg)
    zero, one = np.zeros((count, count)), np.eye(count)
    names = range(1, count + 1)
    return LinearModel(
        state_matrix=np.block([[zero, one], [-mobility @ stiffness, -mobility @ damping]]),
        input_matrix=np.vstack([zero, mobility]),
        output_matrix=np.eye(2 * count),
        feedthrough=np.zeros((2 * count, count)),
        inputs=tuple(f"force_{n}" for n in names),
        outputs=tuple(f"{what}_{n}" for what in ("position", "speed") for n in names),
    )


def _between_neighbours(constants: Floats) -> Floats:
    """Matrix (n, n) of constants (n - 1,) that act on the differences of neighbours."""
    difference = np.diff(np.eye(len(constants) + 1), axis=0)
    return difference.T @ np.diag(constants) @ difference


def _check_chain(masses: Floats, springs: Floats, dampers: Floats, ground: Floats) -> None:
    count = len(masses)
    for name, values, length in (
        ("masses_kg", masses, max(count, 1)),
        ("springs_n_per_m", springs, count - 1),
        ("dampers_n_s_per_m", dampers, count - 1),
        ("ground_n_s_per_m", ground, count),
    ):
        if values.shape != (length,):
            raise ValueError(f"{name}: expected shape ({length},), got {values.shape}")
        if not np.isfinite(values).all() or np.any(values < 0.0):
            raise ValueError(f"{name}: expected finite numbers, none of them negative")
    if not np.all(masses > 0.0):
        raise ValueError("masses_kg: expected every mass to be greater than 0")
