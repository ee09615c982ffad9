"""One self-contained page from a template: nothing in it is loaded from elsewhere."""

from collections.abc import Callable, Mapping
from importlib.resources import files

from jinja2 import Environment, StrictUndefined


def rendered(template: str, filters: Mapping[str, Callable[..., object]], **content: object) -> str:
    """HTML of a template of this folder; a name that it lacks is an error."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(filters)
    source = files(__package__).joinpath("templates", template).read_text("utf-8")
    return environment.from_string(source).render(**content)
