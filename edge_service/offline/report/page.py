"""One self-contained page from a template: nothing in it is loaded from elsewhere."""

from collections.abc import Callable, Mapping
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, StrictUndefined
from matplotlib.figure import Figure

from ...atomic import replaced_file
from .pictures import as_svg, write_png


def rendered(template: str, filters: Mapping[str, Callable[..., object]], **content: object) -> str:
    """HTML of a template of this folder; a name that it lacks is an error."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(filters)
    source = files(__package__).joinpath("templates", template).read_text("utf-8")
    return environment.from_string(source).render(**content)


def write_study(out: Path, name: str, title: str, verdict: str, text: str, figure: Figure) -> None:
    """Write `report.html` and its picture, `NAME.png`, into `out`; the text is a terminal's."""
    page = rendered(
        "study.html",
        {},
        title=title,
        verdict=verdict,
        text=text,
        picture=as_svg(figure, name),
    )
    with replaced_file(out / "report.html") as file:
        file.write(page)
    write_png(figure, out / f"{name}.png")
