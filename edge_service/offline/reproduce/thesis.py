"""`edge-service reproduce`: the thesis' simulations and Table 4.2, beside what was published."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ...atomic import write_whole
from ...command_answer import progress
from ...estimate.imm.modes import PUBLISHED_EXPONENT, moving_average, weighted_level
from ...messages.samples import Floats
from ..report.page import ESTIMATE, MUTED, STYLE, TRUTH, as_svg, rendered
from .simulation import (
    LEVELS,
    ThesisCase,
    has_false_drop,
    mean_absolute_error,
    run_case,
    smoothed_preload,
    steps_to_see_drop,
)

DROP_STEPS = 3
COLOURS = (ESTIMATE, "#c9820b", "#c0392b", "#12857a", "#7b2d8b")
_PRELOAD, _PROBABILITY = "preload, % of dynamic load rating", "mode probability"
SEEDS = 60
MAE_WINDOW_STEPS = 20
WINDOWS_STEPS = (1, 3, 5, 10, 20, 40)
TABLE_WINDOW_STEPS = 50
"""Centred window with which simulation 1 comes closest to the published Table 4.2."""
PUBLISHED_TABLE: dict[float, tuple[tuple[float, ...], float, float]] = {
    10.0: ((0.85, 0.07, 0.04, 0.03, 0.02), 9.3, 9.7),
    7.5: ((0.04, 0.88, 0.04, 0.02, 0.02), 7.3, 7.5),
    5.0: ((0.04, 0.05, 0.85, 0.04, 0.03), 5.1, 5.0),
    2.5: ((0.02, 0.02, 0.04, 0.89, 0.03), 2.7, 2.5),
    0.0: ((0.02, 0.02, 0.03, 0.05, 0.87), 0.6, 0.3),
}
"""Table 4.2: actual preload -> mode probabilities, linear and exponential prediction, percent."""


@dataclass(frozen=True, slots=True)
class LevelRow:
    """One constant level: the published row of Table 4.2 and ours, percent."""

    actual_percent: float
    published_probability: tuple[float, ...]
    published_linear_percent: float
    published_percent: float
    # probability, linear_percent, percent: mean over runs of constant preload
    probability: tuple[float, ...]
    linear_percent: float
    percent: float
    sliding_percent: float  # the same of the sliding innovation bank
    # read from the ramp of simulation 1 where it passes the level, with a centred window of
    # TABLE_WINDOW_STEPS
    ramp_percent: float


@dataclass(frozen=True, slots=True)
class WindowRow:
    """One causal window: mean absolute error in points of simulations 1 to 5, and its reaction."""

    window_steps: int
    mae_points: tuple[float, ...]
    # most steps that any run of simulation 4 took to see the drop; None if one never did
    drop_steps: int | None
    false_drop_share: float  # share of the runs of simulation 3 with a false drop


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Content of `reproduction.json`."""

    seeds: int
    exponent: float
    window_steps: int  # of the accuracy
    levels: tuple[LevelRow, ...]
    windows: tuple[WindowRow, ...]

    def window(self, steps: int) -> WindowRow:
        return next(row for row in self.windows if row.window_steps == steps)

    def as_text(self) -> str:
        """The tables, for a terminal."""
        lines = [
            f"Table 4.2, constant levels, mean of {self.seeds} seeds, exponent {self.exponent:g} "
            "(published in brackets)",
            f"ramp: read from simulation 1, centred window of {TABLE_WINDOW_STEPS} steps",
            f"actual   own mode     linear       exp {self.exponent:<4g}      sliding  ramp",
        ]
        for index, row in enumerate(self.levels):
            lines.append(
                f"{row.actual_percent:5.1f} %"
                f"  {row.probability[index]:.2f} ({row.published_probability[index]:.2f})"
                f"  {row.linear_percent:5.2f} ({row.published_linear_percent:4.1f})"
                f"  {row.percent:5.2f} ({row.published_percent:4.1f})"
                f"  {row.sliding_percent:6.2f}  {row.ramp_percent:5.2f}"
            )
        lines += [
            f"\nMean absolute error in points, causal moving average, exponent {self.exponent:g}",
            "window   sim 1  sim 2  sim 3  sim 4  sim 5  drop seen after  false drops in sim 3",
        ]
        for each in self.windows:
            errors = "  ".join(f"{value:.3f}" for value in each.mae_points)
            seen = "never" if each.drop_steps is None else f"{each.drop_steps} steps"
            lines.append(
                f"{each.window_steps:6d}   {errors}  {seen:>15}  {each.false_drop_share:20.0%}"
            )
        shares = [100.0 - 10.0 * each for each in self.window(self.window_steps).mae_points]
        lines.append(
            f"accuracy as a share of the full 10 points, window of {self.window_steps}: "
            f"{min(shares):.1f} to {max(shares):.1f} % (published, 4.6.6: 95 to 98 %)"
        )
        return "\n".join(lines)


def reproduce(
    out_dir: Path,
    seeds: int = SEEDS,
    seed: int = 0,
    window_steps: int = MAE_WINDOW_STEPS,
    exponent: float = PUBLISHED_EXPONENT,
) -> Reproduction:
    """Run the study; write `report.html` and `reproduction.json` into `out_dir`."""
    runs = range(seed, seed + seeds)
    progress("Table 4.2")
    levels = _level_rows(runs, exponent)
    progress("simulations 1 to 5")
    windows = _window_rows(runs, exponent, sorted({*WINDOWS_STEPS, window_steps}))
    result = Reproduction(seeds, exponent, window_steps, levels, windows)
    progress("report")
    text = json.dumps({"schema": "reproduction/1", **asdict(result)}, indent=2, allow_nan=False)
    page = rendered(
        "reproduction.html",
        result=result,
        own_probability=[row.probability[index] for index, row in enumerate(levels)],
        mae_points=result.window(window_steps).mae_points,
        figures=_drawn_figures(seed, window_steps, exponent),
        levels=LEVELS.tolist(),
        table_window_steps=TABLE_WINDOW_STEPS,
        window_steps=window_steps,
    )
    write_whole(out_dir / "reproduction.json", text + "\n")
    write_whole(out_dir / "report.html", page)
    return result


def mean_probability(case: ThesisCase, seeds: range) -> Floats:
    """Mode probabilities (r,), mean over all steps and seeds."""
    runs = [run_case(case, seed)[1].mode_probability.mean(axis=0) for seed in seeds]
    return np.asarray(np.mean(runs, axis=0))


def _level_rows(seeds: range, exponent: float) -> tuple[LevelRow, ...]:
    ramp = ThesisCase(1)
    mean = np.mean([run_case(ramp, seed)[1].mode_probability for seed in seeds], axis=0)
    smoothed = moving_average(mean, TABLE_WINDOW_STEPS, (TABLE_WINDOW_STEPS - 1) // 2)
    ramp_percent = weighted_level(smoothed, LEVELS, exponent)
    truth = ramp.true_preload_percent()
    rows = []
    for level, published in PUBLISHED_TABLE.items():
        probability = mean_probability(ThesisCase(level), seeds)
        sliding = mean_probability(ThesisCase(level, method="sif-imm"), seeds)
        row = LevelRow(
            level,
            *published,
            probability=tuple(probability.tolist()),
            linear_percent=float(probability @ LEVELS),
            percent=float(weighted_level(probability, LEVELS, exponent)),
            sliding_percent=float(weighted_level(sliding, LEVELS, exponent)),
            ramp_percent=float(ramp_percent[np.argmin(np.abs(truth - level))]),
        )
        rows.append(row)
    return tuple(rows)


def _window_rows(seeds: range, exponent: float, windows: Sequence[int]) -> tuple[WindowRow, ...]:
    cases = [ThesisCase(number) for number in (1, 2, 3, 4)] + [ThesisCase(5, method="sif-imm")]
    runs = [[run_case(case, seed)[1].mode_probability for seed in seeds] for case in cases]
    truths = [case.true_preload_percent() for case in cases]
    rows = []
    for window in windows:
        estimates = [[smoothed_preload(r, window, exponent) for r in each] for each in runs]
        errors = [
            float(np.mean([mean_absolute_error(estimate, truth) for estimate in case_estimates]))
            for case_estimates, truth in zip(estimates, truths, strict=True)
        ]
        delays = [steps_to_see_drop(estimate, truths[3]) for estimate in estimates[3]]
        seen = [delay for delay in delays if delay is not None]
        drop_steps = max(seen) if len(seen) == len(delays) else None
        false_drops = float(np.mean([has_false_drop(each) for each in estimates[2]]))
        rows.append(WindowRow(window, tuple(errors), drop_steps, false_drops))
    return tuple(rows)


def _drawn_figures(seed: int, window: int, exponent: float) -> dict[str, Any]:
    """Figures by their published numbers, and what their captions state, with one seed's noise."""
    runs = {number: run_case(ThesisCase(number), seed) for number in (1, 2, 3, 4, 5)}
    _, sliding = run_case(ThesisCase(5, method="sif-imm"), seed)
    truth = {number: run.preload_percent for number, (run, _) in runs.items()}
    modes = {number: bank.mode_probability for number, (_, bank) in runs.items()}
    smooth = moving_average(modes[1], window)
    by_exponent = {
        ("linear" if each == 1.0 else f"exponent {each:g}"): weighted_level(smooth, LEVELS, each)
        for each in (1.0, 1.33, 2.0)
    }
    estimates = {number: smoothed_preload(modes[number], window, exponent) for number in runs}
    quick = smoothed_preload(modes[4], DROP_STEPS, exponent)
    slid = smoothed_preload(sliding.mode_probability, window, exponent)
    first, levels = runs[1][0], [f"{level:g} %" for level in LEVELS]
    torques = {"torque command u": first.torque_nm, "net torque û": first.net_torque_nm}
    drops = {f"{DROP_STEPS} steps": quick, f"{window} steps": estimates[4]}
    sliders = {"KF-IMM": estimates[5], "SIF-IMM": slid}
    drawn: dict[str, tuple[Mapping[str, Floats], Floats | None, str]] = {
        "4.3": (torques, None, "N m"),
        "4.4": (dict(zip(levels, modes[1].T, strict=True)), None, _PROBABILITY),
        "4.5": (dict(zip(levels, smooth.T, strict=True)), None, _PROBABILITY),
        "4.6": (by_exponent, truth[1], _PRELOAD),
        "4.7": ({"estimate": estimates[2]}, truth[2], _PRELOAD),
        "4.8": ({"estimate": estimates[3]}, truth[3], _PRELOAD),
        "4.9": (drops, truth[4], _PRELOAD),
        "4.10": (sliders, truth[5], _PRELOAD),
    }
    return {
        "svg": {number: _svg(first.time_s, *content) for number, content in drawn.items()},
        "right_share": {
            "4.4": _right(modes[1], truth[1]),
            "4.5": _right(smooth, truth[1]),
        },
        "error_by_exponent": {
            name: mean_absolute_error(values, truth[1]) for name, values in by_exponent.items()
        },
        "error": {n: mean_absolute_error(estimates[n], truth[n]) for n in runs},
        "lowest_percent": float(estimates[3][window:].min()),
        "drop_window_steps": DROP_STEPS,
        "seen": [steps_to_see_drop(each, truth[4]) for each in (quick, estimates[4])],
        "sliding_error": mean_absolute_error(slid, truth[5]),
        "sliding_difference": mean_absolute_error(estimates[5], slid),
    }


def _right(probability: Floats, truth_percent: Floats) -> float:
    nearest = np.abs(truth_percent[:, None] - LEVELS).argmin(axis=1)
    return float((probability.argmax(axis=1) == nearest).mean())


def _svg(
    time_s: Floats, curves: Mapping[str, Floats], truth_percent: Floats | None, unit: str
) -> str:
    """Curves over time as an SVG element, the legend above; the truth is dashed."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.6, 3.1), layout="constrained")
        axes = figure.subplots()
        colours = (MUTED, ESTIMATE) if len(curves) == 2 else COLOURS
        for (label, values), colour in zip(curves.items(), colours, strict=False):
            axes.plot(time_s, values, color=colour, lw=1.2, label=label)
        if truth_percent is not None:
            axes.plot(time_s, truth_percent, "--", color=TRUTH, lw=1.1, label="true preload")
            axes.set_ylim(-0.5, 10.8)
        axes.set(xlabel="time, s", ylabel=unit)
        axes.margins(x=0.01)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=5, borderaxespad=0.2)
        return as_svg(figure, "-".join(curves))
