"""Figures 4.3 to 4.10 of the thesis as inline SVG, with the numbers of their captions."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ...estimate.imm.modes import moving_average, weighted_level
from ...messages.samples import Floats
from ..report.page import ESTIMATE, MUTED, STYLE, TRUTH, as_svg
from .simulation import (
    LEVELS,
    ThesisCase,
    mean_absolute_error,
    run_case,
    smoothed_preload,
    steps_to_see_drop,
)

DROP_STEPS = 3
COLOURS = (ESTIMATE, "#c9820b", "#c0392b", "#12857a", "#7b2d8b")
_PRELOAD, _PROBABILITY = "preload, % of dynamic load rating", "mode probability"


def drawn_figures(seed: int, window: int, exponent: float) -> dict[str, Any]:
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
            "4.4": _right_share(modes[1], truth[1]),
            "4.5": _right_share(smooth, truth[1]),
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


def _right_share(probability: Floats, truth_percent: Floats) -> float:
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
