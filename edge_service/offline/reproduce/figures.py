"""The thesis' Figures 4.3 to 4.10 drawn again, as inline SVG."""

from collections.abc import Callable
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...estimate.imm.mode_weighting import causal_moving_average, weighted_level
from ...messages.samples import Floats
from ..report.pictures import ESTIMATE, MUTED, STYLE, TRUTH, as_svg
from .simulation import (
    LEVELS,
    ThesisCase,
    mean_absolute_error,
    run_case,
    smoothed_preload,
    steps_to_see_drop,
)

DROP_STEPS = 3
MODE_COLOURS = ("#7b2d8b", "#2f62c9", "#12857a", "#c9820b", "#c0392b")


@dataclass(frozen=True, slots=True)
class Drawing:
    """Seed of the noise, window of the moving average in steps, exponent of the weighted sum."""

    seed: int
    window: int
    exponent: float

    def smoothed(self, mode_probability: Floats, scale: int = 1) -> Floats:
        """Preload, percent, with the window `scale` times as long."""
        return smoothed_preload(mode_probability, scale * self.window, self.exponent)


@dataclass(frozen=True, slots=True)
class DrawnFigure:
    """One figure of the report.

    Attributes:
        heading: number of the published figure, if any, and title.
        settings: window, exponent and discretisation behind it.
        comparison: how it compares with what was published.
    """

    heading: str
    svg: str
    settings: str
    comparison: str


def draw_figures(drawing: Drawing) -> tuple[DrawnFigure, ...]:
    """All figures; every one of them uses the noise of the same seed."""
    with mpl.rc_context(STYLE):
        return (
            _inputs(drawing),
            _modes(drawing, "4.4", 1),
            _modes(drawing, "4.5", drawing.window),
            _exponents(drawing),
            _estimate(drawing, "4.7", ThesisCase(2), "Simulation 2, 7.5 % to 2.5 %"),
            _estimate(drawing, "4.8", ThesisCase(3), "Simulation 3, constant 10 %"),
            _drop(drawing),
            _sliding(drawing),
            _short_steps(drawing),
        )


def _inputs(drawing: Drawing) -> DrawnFigure:
    run, _ = run_case(ThesisCase(1), drawing.seed)

    def draw(axes: Axes) -> None:
        axes.plot(run.time_s, run.torque_nm, color=MUTED, lw=1.0, label="torque command u")
        axes.plot(run.time_s, run.net_torque_nm, color=ESTIMATE, lw=1.2, label="net torque û")
        axes.set(ylabel="N m")

    return DrawnFigure(
        "Figure 4.3: Simulation 1, system input",
        _svg("inputs", draw, columns=2),
        "No filter. u = 2 sin t (4.6.8); û by (4.6.9), drag 0.30 N m falling to 0.",
        "As published: the net input grows as the drag goes, by 0.30 N m at the crests; "
        "while |u| is below the drag the net input is zero and carries no information.",
    )


def _modes(drawing: Drawing, number: str, window: int) -> DrawnFigure:
    run, bank = run_case(ThesisCase(1), drawing.seed)
    probability = causal_moving_average(bank.mode_probability, window)

    def draw(axes: Axes) -> None:
        for level, colour, values in zip(LEVELS, MODE_COLOURS, probability.T, strict=True):
            axes.plot(run.time_s, values, color=colour, lw=1.1, label=f"{level:g} %")
        axes.set(ylabel="mode probability", ylim=(-0.02, 1.02))

    right = float((probability.argmax(axis=1) == _nearest_level(run.preload_percent)).mean())
    smoothing = "not smoothed" if window == 1 else f"causal moving average of {window} steps"
    name = "mode probabilities" if window == 1 else "smoothed mode probabilities"
    return DrawnFigure(
        f"Figure {number}: Simulation 1, {name}",
        _svg(f"modes-{window}", draw, columns=5),
        f"KF-IMM, {smoothing}, no activation, Euler at 0.1 s.",
        f"The nearest level has the largest probability in {right:.0%} of the steps. As published: "
        + (
            "noisy, with the pattern clear."
            if window == 1
            else "each level takes over from the one above. The published window is not given."
        ),
    )


def _nearest_level(preload_percent: Floats) -> Floats:
    return np.asarray(np.abs(preload_percent[:, None] - LEVELS).argmin(axis=1))


def _exponents(drawing: Drawing) -> DrawnFigure:
    run, bank = run_case(ThesisCase(1), drawing.seed)
    smooth = causal_moving_average(bank.mode_probability, drawing.window)
    estimates = {
        exponent: weighted_level(smooth, LEVELS, exponent) for exponent in (1.0, 1.33, 2.0)
    }

    def draw(axes: Axes) -> None:
        for (exponent, values), colour in zip(
            estimates.items(), ("#c9820b", ESTIMATE, "#c0392b"), strict=True
        ):
            label = "linear" if exponent == 1.0 else f"exponent {exponent:g}"
            axes.plot(run.time_s, values, color=colour, lw=1.2, label=label)
        _truth(axes, run.time_s, run.preload_percent)

    errors = ", ".join(
        f"{mean_absolute_error(values, run.preload_percent):.2f} (exponent {exponent:g})"
        for exponent, values in estimates.items()
    )
    return DrawnFigure(
        "Figure 4.6: Simulation 1, preload with different weighing",
        _svg("exponents", draw, columns=4),
        f"KF-IMM, causal moving average of {drawing.window} steps, Euler at 0.1 s.",
        f"Mean absolute error in points: {errors}. As published: the linear sum is pulled inwards "
        "at both ends, exponent 2 swings about the truth in steps, 1.33 lies between.",
    )


def _estimate(drawing: Drawing, number: str, case: ThesisCase, title: str) -> DrawnFigure:
    run, bank = run_case(case, drawing.seed)
    estimate = drawing.smoothed(bank.mode_probability)

    def draw(axes: Axes) -> None:
        axes.plot(run.time_s, estimate, color=ESTIMATE, lw=1.3, label="estimate")
        _truth(axes, run.time_s, run.preload_percent)

    error = mean_absolute_error(estimate, run.preload_percent)
    lowest = float(estimate[drawing.window :].min())
    compared = (
        f"Lowest estimate {lowest:.2f} %: no false drop, as published."
        if case.preload == 3
        else "It follows the loss from another start to another end, as published."
    )
    return DrawnFigure(
        f"Figure {number}: {title}",
        _svg(f"estimate-{number}", draw, columns=2),
        f"KF-IMM, causal moving average of {drawing.window} steps, "
        f"exponent {drawing.exponent:g}, Euler at 0.1 s.",
        f"Mean absolute error {error:.2f} points. {compared}",
    )


def _drop(drawing: Drawing) -> DrawnFigure:
    run, bank = run_case(ThesisCase(4), drawing.seed)
    windows = {DROP_STEPS: ESTIMATE, drawing.window: "#c9820b"}
    estimates = {
        window: smoothed_preload(bank.mode_probability, window, drawing.exponent)
        for window in windows
    }

    def draw(axes: Axes) -> None:
        for window, colour in windows.items():
            axes.plot(run.time_s, estimates[window], color=colour, lw=1.1, label=f"{window} steps")
        _truth(axes, run.time_s, run.preload_percent)
        close = axes.inset_axes((0.62, 0.34, 0.36, 0.58))
        shown = slice(495, 526)
        for window, colour in windows.items():
            close.plot(run.time_s[shown], estimates[window][shown], color=colour, marker=".", ms=4)
        close.plot(run.time_s[shown], run.preload_percent[shown], "--", color=TRUTH, lw=1.0)
        close.set_facecolor("white")

    delays = {w: steps_to_see_drop(e, run.preload_percent) for w, e in estimates.items()}
    return DrawnFigure(
        "Figure 4.9: Simulation 4, sudden drop at half time",
        _svg("drop", draw, columns=3),
        f"KF-IMM, causal moving averages of {DROP_STEPS} and of {drawing.window} steps, exponent "
        f"{drawing.exponent:g}, Euler at 0.1 s. Inset: 3 s around the drop.",
        f"The estimate passes 5 % in step {delays[DROP_STEPS]} with the window of {DROP_STEPS} "
        "(published: within 3 time steps; Euler shows the first effect in the second), and in step "
        f"{delays[drawing.window]} with the window of {drawing.window}. "
        "Speed and smoothness are not had with one and the same window.",
    )


def _sliding(drawing: Drawing) -> DrawnFigure:
    run, kalman = run_case(ThesisCase(5), drawing.seed)
    _, sliding = run_case(ThesisCase(5, method="sif-imm"), drawing.seed)
    first = drawing.smoothed(kalman.mode_probability)
    second = drawing.smoothed(sliding.mode_probability)

    def draw(axes: Axes) -> None:
        axes.plot(run.time_s, first, color=MUTED, lw=1.3, label="KF-IMM")
        axes.plot(run.time_s, second, color=ESTIMATE, lw=1.1, label="SIF-IMM")
        _truth(axes, run.time_s, run.preload_percent)

    return DrawnFigure(
        "Figure 4.10: Simulation 5, sliding innovation filter",
        _svg("sliding", draw, columns=3),
        f"SIF-IMM, delta = (0.05 rad, 0.07 m), causal moving average of {drawing.window} steps, "
        f"exponent {drawing.exponent:g}, Euler at 0.1 s.",
        f"Mean absolute error {mean_absolute_error(second, run.preload_percent):.2f} points, "
        f"KF-IMM {mean_absolute_error(first, run.preload_percent):.2f}; the two differ by "
        f"{mean_absolute_error(first, second):.2f} on average. As published: very similar. The "
        "gain on the speed is exactly zero, so the speed is predicted and never corrected.",
    )


def _short_steps(drawing: Drawing) -> DrawnFigure:
    scaled = ThesisCase(1, step_s=0.01)
    printed = ThesisCase(1, step_s=0.01, rescale=False)
    run, bank = run_case(scaled, drawing.seed)
    _, unscaled = run_case(printed, drawing.seed)
    good = drawing.smoothed(bank.mode_probability, 10)
    poor = drawing.smoothed(unscaled.mode_probability, 10)

    def draw(axes: Axes) -> None:
        axes.plot(run.time_s, poor, color=MUTED, lw=1.2, label="matrix as printed")
        axes.plot(run.time_s, good, color=ESTIMATE, lw=1.2, label="matrix scaled to the step")
        _truth(axes, run.time_s, run.preload_percent)

    return DrawnFigure(
        "Not in print: Simulation 1 in steps of 0.01 s",
        _svg("short-steps", draw, columns=3),
        f"KF-IMM, causal moving average of {10 * drawing.window} steps, "
        f"exponent {drawing.exponent:g}, Euler at 0.01 s, process noise scaled with the step.",
        "The thesis reports failure below 0.1 s. That comes from using the printed matrix per "
        "step: levels then change ten times as often per second "
        f"({mean_absolute_error(poor, run.preload_percent):.2f} points of error). Scaled as "
        f"P^(T/0.1 s) the method works ({mean_absolute_error(good, run.preload_percent):.2f}).",
    )


def _truth(axes: Axes, time_s: Floats, preload_percent: Floats) -> None:
    axes.plot(time_s, preload_percent, "--", color=TRUTH, lw=1.1, label="true preload")
    axes.set(ylabel="preload, % of dynamic load rating", ylim=(-0.5, 10.8))


def _svg(name: str, draw: Callable[[Axes], None], columns: int) -> str:
    """One panel over time as an SVG element, the legend above it."""
    figure = Figure(figsize=(7.6, 3.1), layout="constrained")
    axes = figure.subplots()
    draw(axes)
    axes.set(xlabel="time, s")
    axes.margins(x=0.01)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.2)
    return as_svg(figure, name)
