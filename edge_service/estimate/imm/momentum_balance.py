"""The exact momentum and angle balance of an interval as one step of a filter bank."""

from dataclasses import dataclass

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from ...models.machine import Machine
from .bank.filter_bank import LinearStep


@dataclass(frozen=True, slots=True)
class MomentumBalanceSettings:
    """Noise of the balance.

    Attributes:
        torque_error_share: error of the modelled torque, mean over 0.1 s, as a share of the torque
            between two neighbouring levels of the bank. About 1 lets the weighted sum read between
            the levels; much less makes it jump from level to level.
        torque_error_nm: its floor, N m.
        angle_noise_rad: noise of the angle, rad.
        speed_noise_rad_s: noise of a speed from neighbouring angles, rad/s.
    """

    torque_error_share: float = 1.0
    torque_error_nm: float = 1e-6
    angle_noise_rad: float = 1e-5
    speed_noise_rad_s: float = 1e-2


class MomentumBalance:
    """Momentum balance as steps of [angle, speed] for modes that differ in their drag torque.

    With J w' = u - D w - (d_j + other) sgn(w) integrated over the interval (thesis, eq. 4.3.4)::

        w_1 = w_0 + (T / J) (mean(u) - D mean(w) - d mean(s))
        a_1 = a_0 + T w_0 + (T^2 / J) (lever(u) - D lever(w) - d lever(s))

    mean(w) and lever(w) come from the measured angle, so that nothing is approximated inside.

    Args:
        machine: inertia, viscous friction and the drag that is not the screw's.
        mode_drag_nm: screw drag torque of each mode, shape (r,).
        settings: noise.
    """

    def __init__(
        self, machine: Machine, mode_drag_nm: Floats, settings: MomentumBalanceSettings
    ) -> None:
        self._inertia = machine.model.inertia_kg_m2.value
        self._viscous = machine.model.viscous_nm_s_per_rad.value
        self._drag = mode_drag_nm + machine.other_drag_nm.value
        spacing = float(np.abs(np.diff(mode_drag_nm)).min()) if len(mode_drag_nm) > 1 else 0.0
        error_nm = max(settings.torque_error_share * spacing, settings.torque_error_nm)
        self._error_density = 0.1 * error_nm**2
        self._measurement_noise = np.diag(
            [settings.angle_noise_rad**2, settings.speed_noise_rad_s**2]
        )

    def start(self, block: FeatureBlock) -> tuple[Floats, Floats]:
        """State (2,) and covariance (2, 2) as measured at the interval's start."""
        return (
            np.array([block.angle_start_rad, block.speed_start_rad_s]),
            self._measurement_noise.copy(),
        )

    def step(self, block: FeatureBlock, mode_transition: Floats) -> tuple[LinearStep, Floats]:
        """The bank's step over the interval, and the measurement (2,) at its end."""
        duration, inertia = block.duration_s, self._inertia
        speed_mean = (block.angle_end_rad - block.angle_start_rad) / duration
        speed_lever = (block.angle_mean_rad - block.angle_start_rad) / duration
        net_mean = (
            block.torque_mean_nm - self._viscous * speed_mean - self._drag * block.direction_mean
        )
        net_lever = (
            block.torque_lever_nm - self._viscous * speed_lever - self._drag * block.direction_lever
        )
        drive = np.column_stack([duration**2 * net_lever, duration * net_mean]) / inertia
        noise = self._error_density / inertia**2
        step = LinearStep(
            transition=np.array([[1.0, duration], [0.0, 1.0]]),
            drive=drive,
            process_noise=noise
            * np.array([[duration**3 / 3.0, duration**2 / 2.0], [duration**2 / 2.0, duration]]),
            observation=np.eye(2),
            measurement_noise=self._measurement_noise,
            mode_transition=mode_transition,
        )
        return step, np.array([block.angle_end_rad, block.speed_end_rad_s])
