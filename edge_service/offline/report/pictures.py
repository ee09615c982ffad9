"""A figure as text for a page, or as a file of its own."""

import io
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from ...atomic import replaced_file
from .figures import STYLE

_DPI = 130


def as_svg(figure: Figure, salt: str) -> str:
    """An SVG element; the same figure and salt give the same text."""
    stream = io.StringIO()
    with mpl.rc_context({**STYLE, "svg.hashsalt": salt}):
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    return text[text.index("<svg") :]


def write_png(figure: Figure, path: Path, dpi: int = _DPI) -> None:
    """A PNG file, whole or not at all."""
    stream = io.BytesIO()
    with mpl.rc_context(STYLE):
        figure.savefig(stream, format="png", dpi=dpi, metadata={"Software": None})
    with replaced_file(path) as file:
        file.buffer.write(stream.getvalue())
