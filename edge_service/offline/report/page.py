"""Look of all figures, and self-contained pages from templates that load nothing from elsewhere."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from ...atomic import replaced_bytes, write_whole

_DPI = 130
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
    undated = {"Date": None, "Creator": None}
    with mpl.rc_context({**STYLE, "svg.hashsalt": salt}):
        figure.savefig(stream, format="svg", metadata=undated, dpi=dpi or "figure")
    text = stream.getvalue()
    return text[text.index("<svg") :]


def write_png(figure: Figure, path: Path, dpi: int = _DPI) -> None:
    """A PNG file, whole or not at all."""
    with mpl.rc_context(STYLE), replaced_bytes(path) as file:
        figure.savefig(file, format="png", dpi=dpi, metadata={"Software": None})


def rendered(
    template: str, filters: Mapping[str, Callable[..., object]] | None = None, **content: object
) -> str:
    """HTML, or text, of a template of this folder; a name that it lacks is an error."""
    is_page = template.endswith(".html")
    loader, strict = PackageLoader(__package__), StrictUndefined
    environment = Environment(loader=loader, autoescape=is_page, undefined=strict, trim_blocks=True)
    environment.filters.update(filters or {})
    return environment.get_template(template).render(**content)


def write_study(out: Path, name: str, title: str, verdict: str, text: str, figure: Figure) -> None:
    """Write `report.html` and its picture, `NAME.png`, into `out`; the text is a terminal's."""
    picture = as_svg(figure, name)
    page = rendered("study.html", title=title, verdict=verdict, text=text, picture=picture)
    write_whole(out / "report.html", page)
    write_png(figure, out / f"{name}.png")
