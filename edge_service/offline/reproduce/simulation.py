"""The thesis' simulated feed drive and its filters: open loop, one inertia (section 4.6).

The direction of friction is that of the torque command here, as printed in (4.6.9); everywhere else
it is that of the speed. Table 4.1 prints R_t = 1.59e-3 m/rad; (4.3.5) with a lead of 20 mm gives
3.183e-3, which is used.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ...estimate.imm.bank import KALMAN, BankOutput, BankStart, LinearStep, run_bank
from ...estimate.imm.mode_transition import (
    LEVELS_PERCENT,
    THESIS_MODE_TRANSITION,
    scaled_mode_transition,
)
from ...estimate.imm.mode_weighting import PUBLISHED_EXPONENT, causal_moving_average, weighted_level
from ...messages.samples import Floats
from ...models.compiled import compiled
from ...models.screw.ball_screw import transmission_ratio

Discretisation = Literal["euler", "exact"]
PRINTED_STEP_S = 0.1
DURATION_S = 100.0
DRAG_PER_PERCENT_NM = 0.03
"""Drag torque per point of preload: 0.30 N m at 10 % (section 4.6.1)."""
LEVELS: Floats = np.array(LEVELS_PERCENT)
SLIDING_BOUNDARY: Floats = np.array([0.05, 0.07])
"""delta (4.6.10), rad and m."""
START_VARIANCE = 1e-2
"""Variance of both states at the start; not given in print, gone after a few steps."""
TABLE_WINDOW_STEPS = 50
"""Centred window with which simulation 1 comes closest to the published Table 4.2."""
SEEN_BELOW_PERCENT = 5.0
"""A full drop counts as seen when the estimate passes the middle between before and after."""
FALSE_DROP_PERCENT = 7.5
"""At a true 10 %, an estimate below the next level is a false drop."""
SETTLED_STEPS = 20
"""False drops are counted after these; the bank starts with all levels equally likely."""


@dataclass(frozen=True, slots=True, eq=False)
class PlantMatrices:
    """Discrete plant with states [angle, speed, linear position] (4.6.4-4.6.7).

    Attributes:
        transition: A, (3, 3). Its last row is R_t times the first and its last column is zero: the
            linear position is no dynamic state.
        input: B, per N m of net torque, (3,).
        process_noise: Q, (3, 3).
        observation: C, (2, 3): the rotary and the linear encoder.
        measurement_noise: R, (2, 2).
    """

    transition: Floats
    input: Floats
    process_noise: Floats
    observation: Floats
    measurement_noise: Floats


@dataclass(frozen=True, slots=True)
class ThesisPlant:
    """Parameters of Table 4.1 and noise of (4.6.6-4.6.7).

    Attributes:
        angle_noise_var_rad2 and the next two: process noise per printed step of 0.1 s.
        rotary_noise_var_rad2, linear_noise_var_m2: variance of one reading of each encoder.
    """

    inertia_kg_m2: float = 3.3e-3
    damping_nm_s_per_rad: float = 1.98e-2
    ratio_m_per_rad: float = field(default_factory=lambda: transmission_ratio(0.02))
    angle_noise_var_rad2: float = 1e-3
    speed_noise_var_rad2_s2: float = 1e-2
    linear_noise_share: float = 1e-3  # times R_t gives m^2, as printed
    rotary_noise_var_rad2: float = 1e-4
    linear_noise_var_m2: float = 2e-5

    def matrices(
        self, step_s: float = PRINTED_STEP_S, discretisation: Discretisation = "euler"
    ) -> PlantMatrices:
        """The plant at a step of `step_s`; process noise grows with the step."""
        motion, push = self._motion(step_s, discretisation)
        ratio = self.ratio_m_per_rad
        transition = np.zeros((3, 3))
        transition[:2, :2] = motion
        transition[2, :2] = ratio * motion[0]
        noise = (
            self.angle_noise_var_rad2,
            self.speed_noise_var_rad2_s2,
            ratio * self.linear_noise_share,
        )
        return PlantMatrices(
            transition=transition,
            input=np.array([push[0], push[1], ratio * push[0]]),
            process_noise=np.diag(noise) * (step_s / PRINTED_STEP_S),
            observation=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
            measurement_noise=np.diag([self.rotary_noise_var_rad2, self.linear_noise_var_m2]),
        )

    def reduced(
        self, step_s: float = PRINTED_STEP_S, discretisation: Discretisation = "euler"
    ) -> PlantMatrices:
        """The same plant with states [angle, speed] only; (2, 2) matrices, B (2,).

        The linear encoder then reads R_t times the angle, with the noise of the third state added
        to its own. In print the third state follows the angle as it was before the process noise of
        the same step. With w_3 = R_t w_1 + own noise, the two forms are the same filter.
        """
        full = self.matrices(step_s, discretisation)
        measurement_noise = full.measurement_noise.copy()
        measurement_noise[1, 1] += full.process_noise[2, 2]
        return PlantMatrices(
            transition=full.transition[:2, :2],
            input=full.input[:2],
            process_noise=full.process_noise[:2, :2],
            observation=np.array([[1.0, 0.0], [self.ratio_m_per_rad, 0.0]]),
            measurement_noise=measurement_noise,
        )

    def _motion(self, step_s: float, discretisation: Discretisation) -> tuple[Floats, Floats]:
        """Transition (2, 2) and input (2,) of angle and speed."""
        inertia, damping = self.inertia_kg_m2, self.damping_nm_s_per_rad
        if discretisation == "euler":
            transition = np.array([[1.0, step_s], [0.0, 1.0 - damping * step_s / inertia]])
            return transition, np.array([0.0, step_s / inertia])
        settled = -np.expm1(-damping * step_s / inertia)
        travel_s = settled * inertia / damping
        transition = np.array([[1.0, travel_s], [0.0, 1.0 - settled]])
        return transition, np.array([(step_s - travel_s) / damping, settled / damping])


@dataclass(frozen=True, slots=True, eq=False)
class ThesisRun:
    """One simulated run; row k holds the input of step k and what is measured at its end.

    Attributes:
        time_s, torque_nm, net_torque_nm, preload_percent: (N,).
        state: after the step, (N, 3).
        measurement: after the step, (N, 2), rad and m.
    """

    time_s: Floats
    torque_nm: Floats
    net_torque_nm: Floats
    preload_percent: Floats
    state: Floats
    measurement: Floats


def torque_command(time_s: Floats) -> Floats:
    """u(t) = 2 sin(t), N m (4.6.8)."""
    return np.asarray(2.0 * np.sin(time_s))


def net_torque(torque_nm: Floats, drag_nm: Floats) -> Floats:
    """Remainder of the torque command after the drag, in its direction (4.6.9), N m."""
    return np.asarray(np.sign(torque_nm) * np.maximum(np.abs(torque_nm) - np.abs(drag_nm), 0.0))


def preload_profile(simulation: int, time_s: Floats, duration_s: float = DURATION_S) -> Floats:
    """True preload in percent over the thesis' simulations 1 to 5, (N,)."""
    share = time_s / duration_s
    if simulation in (1, 5):
        return np.asarray(10.0 - 10.0 * share)
    if simulation == 2:
        return np.asarray(7.5 - 5.0 * share)
    if simulation == 3:
        return np.full(len(time_s), 10.0)
    if simulation == 4:
        return np.where(share < 0.5, 10.0, 0.0)
    raise ValueError(f"simulation {simulation}: expected 1 to 5")


@compiled
def follow(transition: Floats, forcing: Floats) -> Floats:
    """States (N, n) of x_{k+1} = A x_k + f_k from rest (4.6.1); A is (n, n), f (N, n)."""
    states = forcing.copy()
    for k in range(1, len(states)):
        for a in range(len(transition)):
            for b in range(len(transition)):
                states[k, a] += transition[a, b] * states[k - 1, b]
    return states


def simulate(
    plant: ThesisPlant,
    preload_percent: Floats,
    generator: np.random.Generator,
    step_s: float = PRINTED_STEP_S,
    discretisation: Discretisation = "euler",
) -> ThesisRun:
    """Run the plant from rest with the preload of each step, (N,)."""
    matrices = plant.matrices(step_s, discretisation)
    count = len(preload_percent)
    time_s = np.asarray(np.arange(count) * step_s, dtype=np.float64)
    torque_nm = torque_command(time_s)
    net_nm = net_torque(torque_nm, preload_percent * DRAG_PER_PERCENT_NM)
    noise = generator.standard_normal((count, 5))
    disturbance = noise[:, :3] * np.sqrt(np.diagonal(matrices.process_noise))
    reading = noise[:, 3:] * np.sqrt(np.diagonal(matrices.measurement_noise))
    state = follow(matrices.transition, np.outer(net_nm, matrices.input) + disturbance)
    measurement = state @ matrices.observation.T + reading
    return ThesisRun(time_s, torque_nm, net_nm, preload_percent, state, measurement)


@dataclass(frozen=True, slots=True)
class ThesisCase:
    """One way to run a simulation.

    Attributes:
        preload: number of the thesis' simulation, 1 to 5, or a constant level in percent.
        method: Kalman or sliding innovation filters.
        step_s, discretisation: of plant and filter alike.
        rescale: whether the transition matrix is scaled to the step (it is per 0.1 s in print).
    """

    preload: int | float
    method: Literal["kf-imm", "sif-imm"] = "kf-imm"
    step_s: float = PRINTED_STEP_S
    discretisation: Discretisation = "euler"
    rescale: bool = True

    def true_preload_percent(self) -> Floats:
        """The truth at each step, (N,)."""
        time_s = self.step_s * np.arange(round(DURATION_S / self.step_s), dtype=np.float64)
        if isinstance(self.preload, int):
            return preload_profile(self.preload, time_s)
        return np.full(len(time_s), self.preload)


def bank_inputs(case: ThesisCase, run: ThesisRun) -> tuple[LinearStep, Floats, BankStart]:
    """The filters' shared matrices, the drives B u_hat_j (N, r, n), and the start."""
    matrices = ThesisPlant().reduced(case.step_s, case.discretisation)
    net_nm = net_torque(run.torque_nm[:, None], LEVELS * DRAG_PER_PERCENT_NM)
    drives = net_nm[:, :, None] * matrices.input
    step = LinearStep(
        transition=matrices.transition,
        drive=drives[0],
        process_noise=matrices.process_noise,
        observation=matrices.observation,
        measurement_noise=matrices.measurement_noise,
        mode_transition=scaled_mode_transition(case.step_s)
        if case.rescale
        else THESIS_MODE_TRANSITION,
    )
    size, modes = len(matrices.input), len(LEVELS)
    start = BankStart(np.zeros(size), START_VARIANCE * np.eye(size), np.full(modes, 1.0 / modes))
    return step, drives, start


def run_case(case: ThesisCase, seed: int) -> tuple[ThesisRun, BankOutput]:
    """Simulate and filter; the same seed gives the same noise to every case of one length."""
    run = simulate(
        ThesisPlant(),
        case.true_preload_percent(),
        np.random.default_rng(seed),
        case.step_s,
        case.discretisation,
    )
    step, drives, start = bank_inputs(case, run)
    boundary = SLIDING_BOUNDARY if case.method == "sif-imm" else KALMAN
    return run, run_bank(step, drives, run.measurement, start, boundary)


def smoothed_preload(
    mode_probability: Floats, steps: int, exponent: float = PUBLISHED_EXPONENT
) -> Floats:
    """Preload in percent (N,) from probabilities (N, r) averaged over the last `steps`."""
    return weighted_level(causal_moving_average(mode_probability, steps), LEVELS, exponent)


def mean_absolute_error(estimate_percent: Floats, truth_percent: Floats) -> float:
    """Over all steps, points."""
    return float(np.abs(estimate_percent - truth_percent).mean())


def steps_to_see_drop(estimate_percent: Floats, truth_percent: Floats) -> int | None:
    """Steps until a full drop is seen, the step of the drop being the first; None if never."""
    drop = int(np.argmax(truth_percent < SEEN_BELOW_PERCENT))
    seen = np.flatnonzero(estimate_percent[drop:] < SEEN_BELOW_PERCENT)
    return int(seen[0]) + 1 if len(seen) else None


def has_false_drop(estimate_percent: Floats) -> bool:
    """Fall of an estimate of a constant 10 % below the next level."""
    return bool((estimate_percent[SETTLED_STEPS:] < FALSE_DROP_PERCENT).any())
