"""The thesis' simulated feed drive and its filters: open loop, one inertia (section 4.6).

The direction of friction is that of the torque command here, as printed in (4.6.9); everywhere else
it is that of the speed. Table 4.1 prints R_t = 1.59e-3 m/rad; (4.3.5) with a lead of 20 mm gives
3.183e-3, which is used.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...estimate.imm.bank import KALMAN, BankOutput, BankStart, LinearStep, run_bank
from ...estimate.imm.modes import (
    LEVELS_PERCENT,
    PUBLISHED_EXPONENT,
    moving_average,
    scaled_mode_transition,
    weighted_level,
)
from ...messages.samples import Floats
from ...models.compiled import compiled
from ...models.screw.ball_screw import transmission_ratio

PRINTED_STEP_S = 0.1
DURATION_S = 100.0
INERTIA_KG_M2, DAMPING_NM_S_PER_RAD = 3.3e-3, 1.98e-2
RATIO_M_PER_RAD = transmission_ratio(0.02)
PROCESS_VARIANCE: Floats = np.array([1e-3, 1e-2, RATIO_M_PER_RAD * 1e-3])
"""Of angle, speed and linear position (4.6.6), rad^2, rad^2/s^2 and m^2 per printed step."""
READING_VARIANCE: Floats = np.array([1e-4, 2e-5])
"""Of one reading of the rotary and of the linear encoder (4.6.7), rad^2 and m^2."""
DRAG_PER_PERCENT_NM = 0.03
"""Drag torque per point of preload: 0.30 N m at 10 % (section 4.6.1)."""
LEVELS: Floats = np.array(LEVELS_PERCENT)
SLIDING_BOUNDARY: Floats = np.array([0.05, 0.07])
"""delta (4.6.10), rad and m."""
START_VARIANCE = 1e-2
"""Variance of both states at the start; not given in print, gone after a few steps."""
SEEN_BELOW_PERCENT = 5.0
"""A full drop counts as seen when the estimate passes the middle between before and after."""
FALSE_DROP_PERCENT = 7.5
"""At a true 10 %, an estimate below the next level is a false drop."""
SETTLED_STEPS = 20
"""False drops are counted after these; the bank starts with all levels equally likely."""


@dataclass(frozen=True, slots=True)
class ThesisCase:
    """One way to run a simulation."""

    preload: int | float  # number of the thesis' simulation, 1 to 5, or a constant level in percent
    method: Literal["kf-imm", "sif-imm"] = "kf-imm"  # Kalman or sliding innovation filters
    step_s: float = PRINTED_STEP_S  # of plant and filter alike

    def true_preload_percent(self) -> Floats:
        """The truth at each step, (N,)."""
        time_s = self.step_s * np.arange(round(DURATION_S / self.step_s), dtype=np.float64)
        if isinstance(self.preload, int):
            return preload_profile(self.preload, time_s)
        return np.full(len(time_s), self.preload)


@dataclass(frozen=True, slots=True, eq=False)
class ThesisRun:
    """One simulated run; row k holds the input of step k and what is measured at its end."""

    # time_s, torque_nm, net_torque_nm, preload_percent: (N,)
    time_s: Floats
    torque_nm: Floats
    net_torque_nm: Floats
    preload_percent: Floats
    state: Floats  # angle, speed and linear position after the step, (N, 3)
    measurement: Floats  # after the step, (N, 2), rad and m


def preload_profile(simulation: int, time_s: Floats) -> Floats:
    """Preload of the plant, percent, over the thesis' simulations 1 to 5, (N,)."""
    share = time_s / DURATION_S
    profiles = {
        1: 10.0 - 10.0 * share,
        2: 7.5 - 5.0 * share,
        3: np.full(len(time_s), 10.0),
        4: np.where(share < 0.5, 10.0, 0.0),
        5: 10.0 - 10.0 * share,
    }
    return np.asarray(profiles[simulation])


def net_torque(torque_nm: Floats, drag_nm: Floats) -> Floats:
    """Remainder of the torque command after the drag, in its direction (4.6.9), N m."""
    return np.asarray(np.sign(torque_nm) * np.maximum(np.abs(torque_nm) - np.abs(drag_nm), 0.0))


def plant_matrices(step_s: float = PRINTED_STEP_S) -> tuple[Floats, Floats]:
    """A (3, 3) and B (3,) of angle, speed and linear position, per N m of net torque (4.6.4).

    Euler, as printed. The linear position is R_t times the angle: no dynamic state.
    """
    decay = 1.0 - DAMPING_NM_S_PER_RAD * step_s / INERTIA_KG_M2
    ratio = RATIO_M_PER_RAD
    transition = np.array([[1.0, step_s, 0.0], [0.0, decay, 0.0], [ratio, ratio * step_s, 0.0]])
    return transition, np.array([0.0, step_s / INERTIA_KG_M2, 0.0])


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
    preload_percent: Floats, generator: np.random.Generator, step_s: float = PRINTED_STEP_S
) -> ThesisRun:
    """Run the plant from rest under u(t) = 2 sin(t) (4.6.8) with the preload of each step, (N,)."""
    transition, push = plant_matrices(step_s)
    count = len(preload_percent)
    time_s = np.asarray(np.arange(count) * step_s, dtype=np.float64)
    torque_nm = np.asarray(2.0 * np.sin(time_s))
    net_nm = net_torque(torque_nm, preload_percent * DRAG_PER_PERCENT_NM)
    noise = generator.standard_normal((count, 5))
    disturbance = noise[:, :3] * np.sqrt(PROCESS_VARIANCE * (step_s / PRINTED_STEP_S))
    state = follow(transition, np.outer(net_nm, push) + disturbance)
    measurement = state[:, ::2] + noise[:, 3:] * np.sqrt(READING_VARIANCE)
    return ThesisRun(time_s, torque_nm, net_nm, preload_percent, state, measurement)


def bank_inputs(case: ThesisCase, run: ThesisRun) -> tuple[LinearStep, Floats, BankStart]:
    """The filters' shared matrices, the drives B u_hat_j (N, r, n), and the start.

    They run with angle and speed alone: the linear encoder reads R_t times the angle, with the
    noise of the third state added to its own. In print the third state follows the angle as it was
    before the process noise of the same step; with w_3 = R_t w_1 + own noise both are one filter.
    """
    transition, push = plant_matrices(case.step_s)
    process = PROCESS_VARIANCE * (case.step_s / PRINTED_STEP_S)
    net_nm = net_torque(run.torque_nm[:, None], LEVELS * DRAG_PER_PERCENT_NM)
    drives = net_nm[:, :, None] * push[:2]
    step = LinearStep(
        transition=transition[:2, :2],
        drive=drives[0],
        process_noise=np.diag(process[:2]),
        observation=np.array([[1.0, 0.0], [RATIO_M_PER_RAD, 0.0]]),
        measurement_noise=np.diag(READING_VARIANCE + np.array([0.0, process[2]])),
        mode_transition=scaled_mode_transition(case.step_s),
    )
    modes = len(LEVELS)
    start = BankStart(np.zeros(2), START_VARIANCE * np.eye(2), np.full(modes, 1.0 / modes))
    return step, drives, start


def run_case(case: ThesisCase, seed: int) -> tuple[ThesisRun, BankOutput]:
    """Simulate and filter; the same seed gives the same noise to every case of one length."""
    run = simulate(case.true_preload_percent(), np.random.default_rng(seed), case.step_s)
    step, drives, start = bank_inputs(case, run)
    boundary = SLIDING_BOUNDARY if case.method == "sif-imm" else KALMAN
    return run, run_bank(step, drives, run.measurement, start, boundary)


def smoothed_preload(
    mode_probability: Floats, steps: int, exponent: float = PUBLISHED_EXPONENT
) -> Floats:
    """Preload in percent (N,) from probabilities (N, r) averaged over the last `steps`."""
    return weighted_level(moving_average(mode_probability, steps), LEVELS, exponent)


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
