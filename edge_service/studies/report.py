"""The study as one self-contained page and one JSON file."""

import json
import os
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, StrictUndefined

from .figures import draw_figures
from .thesis_runs import LEVELS, TABLE_WINDOW_STEPS

if TYPE_CHECKING:
    from .reproduce import Reproduction


def write_report(out_dir: Path, result: "Reproduction", numbers: Mapping[str, Any]) -> None:
    """Write `report.html` and `reproduction.json` into `out_dir`, made if missing.

    Args:
        numbers: the same result as JSON-able values.
    """
    out_dir.mkdir(parents=True, exist_ok=True)
    document = {"schema": "reproduction/1", **numbers}
    write_atomically(
        out_dir / "reproduction.json", json.dumps(document, indent=2, allow_nan=False) + "\n"
    )
    write_atomically(out_dir / "report.html", render(result))


def render(result: "Reproduction") -> str:
    """The page as HTML; nothing in it is loaded from elsewhere."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    source = files(__package__).joinpath("templates/reproduction.html").read_text("utf-8")
    return environment.from_string(source).render(
        result=result,
        figures=draw_figures(),
        levels=LEVELS.tolist(),
        table_window_steps=TABLE_WINDOW_STEPS,
    )


def write_atomically(path: Path, text: str) -> None:
    """Write beside the target and rename, so that a reader never sees half a file."""
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    temporary = Path(name)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            stream.write(text)
        temporary.chmod(0o644)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
