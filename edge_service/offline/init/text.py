"""Text of a first configuration, from the example of its driver, and of its machine file."""

from dataclasses import asdict, dataclass
from pathlib import Path

import tomlkit
from tomlkit.items import AoT

from ...checks.columns.guess import Question
from ...config import DEFAULT_CONFIG
from .source import Source

EXAMPLES = DEFAULT_CONFIG.parent / "drivers"


@dataclass(frozen=True, slots=True)
class Place:
    """Names of a machine, and where its history is kept."""

    site: str
    machine: str
    axis: str
    history: Path


@dataclass(frozen=True, slots=True)
class FirstSheet:
    """Figures of the data sheets of screw and motor, in SI units; None where not known."""

    lead_m: float | None = None
    dynamic_load_rating_n: float | None = None
    inertia_kg_m2: float | None = None
    preload_n: float | None = None
    preload_drag_nm: float | None = None


SHEET_QUESTIONS = {
    "lead_m": (Question("--lead", "Travel per revolution of the motor, mm", "all answers"), 1e-3),
    "inertia_kg_m2": (
        Question("--inertia", "Inertia of all that moves, at the motor, kg m^2", "all answers"),
        1.0,
    ),
    "dynamic_load_rating_n": (
        Question("--load-rating", "Dynamic load rating of the screw, N", "preload in percent"),
        1.0,
    ),
    "preload_n": (
        Question("--preload", "Preload of the fresh screw, N", "preload in percent"),
        1.0,
    ),
    "preload_drag_nm": (
        Question("--preload-drag", "Drag torque of the fresh screw alone, N m", "the preload"),
        1.0,
    ),
}
"""Key of the machine file -> what a person is asked for, and SI units per unit of the answer."""


def configuration_text(source: Source, place: Place, machine: str) -> str:
    """The configuration: who we are, where the history is kept, and the driver's whole example."""
    head = tomlkit.document()
    head["service"] = {"site": place.site, "machine": place.machine}
    head["store"] = {"folder": str(place.history)}
    example = tomlkit.parse((EXAMPLES / f"{source.driver}.toml").read_text("utf-8"))
    axes = example["axes"]
    assert isinstance(axes, AoT)
    axes[0].update({"name": place.axis, "machine": machine})
    axes[0]["settings"].update(source.settings)
    return f"{tomlkit.dumps(head)}\n{tomlkit.dumps(example)}"


def machine_text(name: str, sheet: FirstSheet) -> str:
    """A machine file with what is known."""
    known = {key: value for key, value in asdict(sheet).items() if value is not None}
    of_axis = ("lead_m", "dynamic_load_rating_n")
    axis = {key: known.pop(key) for key in of_axis if key in known}
    return tomlkit.dumps({"axis": {"name": name, **axis}, "model": known})
