"""Pictures of a bench of the diagnosis: are probabilities honest, and what is taken for what."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from edge_service.offline.report.pictures import ESTIMATE, MUTED, STYLE, write_png

from .confusion import NOTHING, UNKNOWN, confusion
from .rows import BenchRow
from .table import reliability


def draw_bench(rows: Sequence[BenchRow], folder: Path) -> list[Path]:
    """Write the pictures into a folder; returns their files."""
    with mpl.rc_context(STYLE):
        figures = {"reliability": _reliability(rows), "confusion": _confusion(rows)}
    files = []
    for name, figure in figures.items():
        files.append(folder / f"diagnosis_{name}.png")
        write_png(figure, files[-1])
    return files


def _reliability(rows: Sequence[BenchRow]) -> Figure:
    """Frequency over probability, with two standard deviations of the frequency."""
    bins = reliability(rows)
    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], color=MUTED, linestyle=":")
    for stated, right, count in bins:
        spread = 2.0 * np.sqrt(max(right * (1.0 - right), 0.25 / count) / count)
        axes.errorbar(stated, right, spread, color=ESTIMATE, marker="o", capsize=2.0)
        axes.annotate(str(count), (stated, right), (5.0, -9.0), textcoords="offset points")
    axes.set(xlim=(0.0, 1.03), ylim=(-0.03, 1.06))
    axes.set_xlabel("probability that is stated")
    axes.set_ylabel("share that is right")
    return figure


def _confusion(rows: Sequence[BenchRow]) -> Figure:
    """Shares of the answers to each cause, as shades with their counts."""
    counts = confusion(rows)
    said = {name for each in counts.values() for name in each}
    columns = [*sorted(said - {NOTHING, UNKNOWN}), NOTHING, UNKNOWN]
    table = np.array([[each[name] for name in columns] for each in counts.values()], dtype=float)
    table = table.reshape(len(counts), len(columns))
    size = (3.2 + 0.3 * len(columns), 2.2 + 0.24 * len(counts))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    share = table / np.maximum(table.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (row, column), count in np.ndenumerate(table):
        if count:
            shade = "white" if share[row, column] > 0.6 else "black"
            axes.text(column, row, f"{count:.0f}", ha="center", va="center", color=shade)
    axes.set_xticks(range(len(columns)), [_words(name) for name in columns], rotation=90)
    axes.set_yticks(range(len(counts)), [_words(name) for name in counts])
    axes.set_xlabel("leads the answer")
    axes.set_ylabel("is there; with no: and withheld from the library")
    axes.grid(visible=False)
    return figure


def _words(name: str) -> str:
    return name.replace("_", " ")
