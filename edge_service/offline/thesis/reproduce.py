"""The thesis' five simulations and Table 4.2 again, beside what was published."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ...estimate.imm.mode_weighting import centred_moving_average, weighted_level
from ...messages.samples import Floats
from .plant import PRINTED_STEP_S, Discretisation
from .report import write_report
from .reproduction import MAE_WINDOW_STEPS, LevelRow, Reproduction, StepRow, WindowRow
from .runs import (
    LEVELS,
    TABLE_WINDOW_STEPS,
    ThesisCase,
    has_false_drop,
    mean_absolute_error,
    run_case,
    smoothed_preload,
    steps_to_see_drop,
)

SEEDS = 60
WINDOWS_STEPS = (1, 3, 5, 10, 20, 40)
SHORT_STEP_S = 0.01
SHORT_STEP_SEEDS = 10

PUBLISHED_TABLE: dict[float, tuple[tuple[float, ...], float, float]] = {
    10.0: ((0.85, 0.07, 0.04, 0.03, 0.02), 9.3, 9.7),
    7.5: ((0.04, 0.88, 0.04, 0.02, 0.02), 7.3, 7.5),
    5.0: ((0.04, 0.05, 0.85, 0.04, 0.03), 5.1, 5.0),
    2.5: ((0.02, 0.02, 0.04, 0.89, 0.03), 2.7, 2.5),
    0.0: ((0.02, 0.02, 0.03, 0.05, 0.87), 0.6, 0.3),
}
"""Table 4.2: actual preload -> mode probabilities, linear and exponential prediction, percent."""

Progress = Callable[[str], None]


def reproduce(
    out_dir: Path,
    seeds: int = SEEDS,
    short_step_seeds: int = SHORT_STEP_SEEDS,
    progress: Progress | None = None,
) -> Reproduction:
    """Run the study; write `report.html` and `reproduction.json` into `out_dir`.

    Args:
        seeds: runs per case with the printed step of 0.1 s.
        short_step_seeds: runs per case in the study of the step length (0.1 and 0.01 s).
        progress: takes a line on what is being worked on.
    """
    if seeds < 1 or short_step_seeds < 1:
        raise ValueError("seeds: expected at least 1")
    say = progress or (lambda _: None)
    say("Table 4.2")
    ramp = _ramp_percent(seeds)
    levels = tuple(_level_row(level, seeds, ramp[level]) for level in PUBLISHED_TABLE)
    say("simulations 1 to 5")
    windows = _window_rows(seeds)
    steps = []
    for step_s in (PRINTED_STEP_S, SHORT_STEP_S):
        say(f"steps of {step_s:g} s")
        steps += _step_rows(step_s, short_step_seeds)
    difference, difference_points = _printed_states_difference()
    result = Reproduction(
        seeds=seeds,
        short_step_seeds=short_step_seeds,
        levels=levels,
        windows=windows,
        steps=tuple(steps),
        printed_states_difference=difference,
        printed_states_difference_points=difference_points,
    )
    say("report")
    write_report(out_dir, result, asdict(result))
    return result


def mean_probability(case: ThesisCase, seeds: int) -> Floats:
    """Mode probabilities (r,), mean over all steps and seeds."""
    runs = [run_case(case, seed)[1].mode_probability.mean(axis=0) for seed in range(seeds)]
    return np.asarray(np.mean(runs, axis=0))


def _level_row(level: float, seeds: int, ramp_percent: float) -> LevelRow:
    published, published_linear, published_percent = PUBLISHED_TABLE[level]
    probability = mean_probability(ThesisCase(level), seeds)
    sliding = mean_probability(ThesisCase(level, method="sif-imm"), seeds)
    return LevelRow(
        actual_percent=level,
        published_probability=published,
        published_linear_percent=published_linear,
        published_percent=published_percent,
        probability=tuple(probability.tolist()),
        linear_percent=float(probability @ LEVELS),
        percent=float(weighted_level(probability, LEVELS)),
        sliding_percent=float(weighted_level(sliding, LEVELS)),
        ramp_percent=ramp_percent,
    )


def _ramp_percent(seeds: int) -> dict[float, float]:
    """Prediction where the ramp of simulation 1 passes each level, percent."""
    case = ThesisCase(1)
    truth = case.true_preload_percent()
    smoothed = [
        centred_moving_average(run_case(case, seed)[1].mode_probability, TABLE_WINDOW_STEPS)
        for seed in range(seeds)
    ]
    percent = weighted_level(np.mean(smoothed, axis=0), LEVELS)
    return {level: float(percent[np.argmin(np.abs(truth - level))]) for level in PUBLISHED_TABLE}


def _window_rows(seeds: int) -> tuple[WindowRow, ...]:
    cases = [ThesisCase(number) for number in (1, 2, 3, 4)] + [ThesisCase(5, method="sif-imm")]
    runs = [[run_case(case, seed)[1].mode_probability for seed in range(seeds)] for case in cases]
    truths = [case.true_preload_percent() for case in cases]
    rows = []
    for window in WINDOWS_STEPS:
        estimates = [[smoothed_preload(run, window) for run in case_runs] for case_runs in runs]
        errors = [
            float(np.mean([mean_absolute_error(estimate, truth) for estimate in case_estimates]))
            for case_estimates, truth in zip(estimates, truths, strict=True)
        ]
        delays = [steps_to_see_drop(estimate, truths[3]) for estimate in estimates[3]]
        seen = [delay for delay in delays if delay is not None]
        rows.append(
            WindowRow(
                window_steps=window,
                mae_points=tuple(errors),
                drop_steps=max(seen) if len(seen) == len(delays) else None,
                false_drop_share=float(np.mean([has_false_drop(e) for e in estimates[2]])),
            )
        )
    return tuple(rows)


def _step_rows(step_s: float, seeds: int) -> list[StepRow]:
    rescales = (True,) if step_s == PRINTED_STEP_S else (True, False)
    discretisations: tuple[Discretisation, ...] = ("euler", "exact")
    return [
        _step_row(step_s, kind, rescale, seeds) for kind in discretisations for rescale in rescales
    ]


def _step_row(step_s: float, kind: Discretisation, rescale: bool, seeds: int) -> StepRow:
    def case(preload: int | float) -> ThesisCase:
        return ThesisCase(preload, step_s=step_s, discretisation=kind, rescale=rescale)

    window = round(MAE_WINDOW_STEPS * PRINTED_STEP_S / step_s)
    probabilities = [mean_probability(case(float(level)), seeds) for level in LEVELS]
    errors = []
    for number in (1, 2, 3, 4):
        truth = case(number).true_preload_percent()
        runs = [run_case(case(number), seed)[1].mode_probability for seed in range(seeds)]
        estimates = [smoothed_preload(run, window) for run in runs]
        errors.append(float(np.mean([mean_absolute_error(e, truth) for e in estimates])))
    return StepRow(
        step_s=step_s,
        discretisation=kind,
        rescaled=rescale,
        percent=tuple(float(weighted_level(p, LEVELS)) for p in probabilities),
        diagonal=tuple(float(p[index]) for index, p in enumerate(probabilities)),
        mae_points=tuple(errors),
    )


def _printed_states_difference() -> tuple[float, float]:
    """Largest difference in a mode probability, and mean one in points, over simulation 1."""
    two = run_case(ThesisCase(1), 0)[1].mode_probability
    three = run_case(ThesisCase(1, printed_states=True), 0)[1].mode_probability
    points = np.abs(
        smoothed_preload(two, MAE_WINDOW_STEPS) - smoothed_preload(three, MAE_WINDOW_STEPS)
    )
    return float(np.abs(two - three).max()), float(points.mean())
