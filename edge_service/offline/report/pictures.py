"""Look of all figures; a figure as text for a page, or as a file of its own."""

import io
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from ...atomic import replaced_file

_DPI = 130
_UNDATED = {"Date": None, "Creator": None}
ESTIMATE, TRUTH, MUTED = "#2f62c9", "#1c2430", "#98a2b0"
STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 9,
    "svg.fonttype": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e7ec",
    "axes.edgecolor": "#8a94a3",
    "legend.frameon": False,
}


def as_svg(figure: Figure, salt: str, dpi: float | None = None) -> str:
    """An SVG element; the same figure and salt give the same text; `dpi` of what is rasterised."""
    stream = io.StringIO()
    with mpl.rc_context({**STYLE, "svg.hashsalt": salt}):
        figure.savefig(stream, format="svg", metadata=_UNDATED, dpi=dpi or "figure")
    text = stream.getvalue()
    return text[text.index("<svg") :]


def write_png(figure: Figure, path: Path, dpi: int = _DPI) -> None:
    """A PNG file, whole or not at all."""
    stream = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    with replaced_file(path) as file:
        file.buffer.write(stream.getvalue())
