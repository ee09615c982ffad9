"""The study as one self-contained page and one JSON file."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...atomic import replaced_file
from ..report.page import rendered
from .figures import draw_figures
from .runs import LEVELS, TABLE_WINDOW_STEPS

if TYPE_CHECKING:
    from .reproduction import Reproduction


def write_report(out_dir: Path, result: "Reproduction", numbers: Mapping[str, Any]) -> None:
    """Write `report.html` and `reproduction.json` into `out_dir`, made if missing.

    Args:
        numbers: the same result as JSON-able values.
    """
    document = {"schema": "reproduction/1", **numbers}
    with replaced_file(out_dir / "reproduction.json") as file:
        file.write(json.dumps(document, indent=2, allow_nan=False) + "\n")
    with replaced_file(out_dir / "report.html") as file:
        file.write(render(result))


def render(result: "Reproduction") -> str:
    """The page as HTML; nothing in it is loaded from elsewhere."""
    return rendered(
        "reproduction.html",
        {},
        result=result,
        figures=draw_figures(),
        levels=LEVELS.tolist(),
        table_window_steps=TABLE_WINDOW_STEPS,
    )
