"""The thesis' simulations: its plant, its filter bank, and scores of what comes out."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from ...estimate.imm.bank.filter_bank import BankOutput, LinearStep
from ...estimate.imm.bank.kalman import BankStart, run_kalman_bank
from ...estimate.imm.bank.mode_transition import (
    LEVELS_PERCENT,
    THESIS_MODE_TRANSITION,
    scaled_mode_transition,
)
from ...estimate.imm.bank.sliding_innovation import run_sliding_innovation_bank
from ...estimate.imm.mode_weighting import PUBLISHED_EXPONENT, causal_moving_average, weighted_level
from ...messages.samples import Floats
from .plant import (
    DRAG_PER_PERCENT_NM,
    DURATION_S,
    PRINTED_STEP_S,
    Discretisation,
    PlantMatrices,
    ThesisPlant,
    ThesisRun,
    net_torque,
    preload_profile,
    simulate,
)

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


@dataclass(frozen=True, slots=True)
class ThesisCase:
    """One way to run a simulation.

    Attributes:
        preload: number of the thesis' simulation, 1 to 5, or a constant level in percent.
        method: Kalman or sliding innovation filters.
        step_s, discretisation: of plant and filter alike.
        rescale: whether the transition matrix is scaled to the step (it is per 0.1 s in print).
        printed_states: filter with the three printed states instead of the two that matter.
    """

    preload: int | float
    method: Literal["kf-imm", "sif-imm"] = "kf-imm"
    step_s: float = PRINTED_STEP_S
    discretisation: Discretisation = "euler"
    rescale: bool = True
    printed_states: bool = False

    def true_preload_percent(self) -> Floats:
        """The truth at each step, (N,)."""
        time_s = self.step_s * np.arange(round(DURATION_S / self.step_s), dtype=np.float64)
        if isinstance(self.preload, int):
            return preload_profile(self.preload, time_s)
        return np.full(len(time_s), self.preload)


def bank_inputs(case: ThesisCase, run: ThesisRun) -> tuple[LinearStep, Floats, BankStart]:
    """The filters' shared matrices, the drives B u_hat_j (N, r, n), and the start."""
    plant = ThesisPlant()
    form = plant.matrices if case.printed_states else plant.reduced
    matrices: PlantMatrices = form(case.step_s, case.discretisation)
    net_nm = net_torque(run.torque_nm[:, None], LEVELS * DRAG_PER_PERCENT_NM)
    drives = net_nm[:, :, None] * matrices.input
    step = LinearStep(
        transition=matrices.transition,
        drive=drives[0],
        process_noise=matrices.process_noise,
        observation=matrices.observation,
        measurement_noise=matrices.measurement_noise,
        mode_transition=_scaled(case.step_s) if case.rescale else THESIS_MODE_TRANSITION,
    )
    size, modes = len(matrices.input), len(LEVELS)
    start = BankStart(np.zeros(size), START_VARIANCE * np.eye(size), np.full(modes, 1.0 / modes))
    return step, drives, start


@cache
def _scaled(step_s: float) -> Floats:
    return scaled_mode_transition(THESIS_MODE_TRANSITION, step_s)


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
    if case.method == "sif-imm":
        return run, run_sliding_innovation_bank(
            step, drives, run.measurement, start, SLIDING_BOUNDARY
        )
    return run, run_kalman_bank(step, drives, run.measurement, start)


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
    """Tell whether an estimate of a constant 10 % falls below the next level."""
    return bool((estimate_percent[SETTLED_STEPS:] < FALSE_DROP_PERCENT).any())
