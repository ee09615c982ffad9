"""Text of a machine file: what its owner states, and what recordings show, each with a reason."""

import difflib
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from typing import Any

import tomlkit
from pydantic import BaseModel

from ..checks.columns.guess import Guess, Question, Understanding
from ..checks.columns.mechanics import Mechanics
from ..config import ConfigError
from ..messages.samples import SI, ColumnMap
from ..models.machine import AxisConfig, ModelConfig, Quantity, ToleranceConfig
from ..models.screw.ball_screw import lead_angle, preload_drag
from ..regression.interval_estimate import IntervalEstimate

Sheet = dict[str, float | str]
"""Key of the machine file -> what its owner states, in SI units."""
Ask = Callable[[Question], float | None]
"""Asks a person one question; None if they do not know."""
_TABLES: dict[str, type[BaseModel]] = {
    "axis": AxisConfig,
    "model": ModelConfig,
    "tolerance": ToleranceConfig,
}
SECTIONS = {key: name for name, table in _TABLES.items() for key in table.model_fields}
_NUMBER = r"[0-9]+(?:\.[0-9]+)?"
_SCREW = re.compile(
    rf"(?:(?P<screw_diameter_m>{_NUMBER})x(?P<lead_m>{_NUMBER}))?"
    rf"(?: ?C(?P<dynamic_load_rating_n>{_NUMBER}))?(?: ?P(?P<preload_n>{_NUMBER}))?"
)
_UNITS = {"_m": "m", "_n": "N", "_nm": "N m", "_rad_s": "rad/s", "_kg": "kg", "_n_per_m": "N/m"}
"""End of a key -> its SI unit."""
_FACTORS = SI | {"kg": (1.0, "kg"), "N/m": (1.0, "N/m"), "N/um": (1e6, "N/m")}
_LEAST_TOLERANCE, _MOST_TOLERANCE = 1e-4, 10.0
CATALOGUE_TOLERANCE = 0.2
"""Of the drag by (4.3.6), whose 0.05 is that of catalogues."""
_LEAST_LOAD = 0.1  # of the dry friction: a constant load that matters
_ASKED = tomllib.loads((files(__package__) / "questions.toml").read_text("utf-8"))
_UNKNOWN = {key: each.pop("missing") for key, each in _ASKED.items() if "missing" in each}
QUESTIONS = {key: Question(**each) for key, each in _ASKED.items()}
"""Key of the machine file -> what a person is asked for."""


def stated(screw: str | None, lead_mm: float | None, given: Sequence[str]) -> Sheet:
    """Keys by a screw's data sheet, its lead and KEY=VALUE, later ones first. Raises ConfigError.

    >>> stated("20x10 C18200", None, ["table_mass_kg=80", "stroke_m=800mm"])["stroke_m"]
    0.8
    """
    sheet: Sheet = {}
    if screw is not None:
        found = _SCREW.fullmatch(screw.strip())
        if not found or not screw.strip():
            raise ConfigError(f'--screw {screw!r}: expected "DIAMETERxLEAD C... P...", mm and N')
        for key, text in found.groupdict().items():
            if text is not None:
                sheet[key] = float(text) * (1e-3 if key.endswith("_m") else 1.0)
    if lead_mm is not None:
        sheet["lead_m"] = 1e-3 * lead_mm
    for each in given:
        key, equals, text = each.partition("=")
        if not equals or key not in SECTIONS:
            near = difflib.get_close_matches(key, SECTIONS, 1)
            hint = f"; did you mean {near[0]}?" if near else "; expected KEY=VALUE"
            raise ConfigError(f"--set {each}: no key of a machine file{hint}")
        sheet[key] = _value(each, key, text.strip())
    return sheet


def _value(given: str, key: str, text: str) -> float | str:
    found = re.fullmatch(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?) ?(.*)", text)
    if found is None:
        return text
    unit = {"Nm": "N m", "mNm": "mN m", "rpm": "rev/min"}.get(found[2], found[2])
    wanted = _UNITS.get(max((end for end in _UNITS if key.endswith(end)), key=len, default=""), "")
    factor, si_unit = _FACTORS.get(unit, (1.0, "")) if unit else (1.0, wanted)
    try:
        number = float(found[1])
    except ValueError:
        raise ConfigError(f"--set {given}: {found[1]!r} is no number") from None
    if si_unit != wanted:
        raise ConfigError(f"--set {given}: {found[2]!r} is no unit of {key}")
    return number * factor


def asked(sheet: Mapping[str, float | str], keys: Sequence[str], ask: Ask | None) -> Sheet:
    """The sheet with what whoever is at the terminal knows; as it is without `ask`."""
    known = dict(sheet)
    for key in keys if ask is not None else ():
        if key not in known and ask is not None and (said := ask(QUESTIONS[key])) is not None:
            known[key] = 1e-3 * said if key == "lead_m" else said
    return known


def stated_text(name: str, sheet: Sheet) -> str:
    tables: dict[str, dict[str, Any]] = {"axis": {"name": name}, "model": {}}
    for key, value in sheet.items():
        tables.setdefault(SECTIONS[key], {})[key] = value
    lead_m = sheet.get("lead_m")
    if drag := drag_of(sheet, None if lead_m is None else float(lead_m)):
        tables["model"]["preload_drag_nm"] = drag.model_dump()
    return tomlkit.dumps(tables)


def machine_text(
    files: Sequence[str],
    understood: Understanding,
    mechanics: Mechanics | None,
    name: str,
    number: int | None,
    sheet: Sheet,
    stroke_m: float | None,
) -> str:
    """The proposed machine file; lines that nothing is known for stand in it as comments."""
    said: dict[str, list[Guess]] = {}
    for guess in understood.guesses:
        said.setdefault(guess.subject, []).append(guess)
    lines = [
        f"# Proposed by `edge-service adopt` from {', '.join(files)}.",
        "# Each line has its reason; look first at those that are assumed.",
        "",
        "[axis]",
        f"name = {_text(name)}",
    ]
    if number is not None:
        lines.append(f"number = {number}  # the controller's number of the axis")
    lines += [*_comments(said, "lead_m"), _number("lead_m", understood.lead_m, "unknown: --lead")]
    if stroke_m is not None and "stroke_m" not in sheet:
        lines.append(f"# stroke_m = ...  # at least {stroke_m:.4g} m, over which it was recorded")
    rating = "dynamic_load_rating_n"
    lines += [_number(rating, sheet.get(rating), _UNKNOWN[rating]), *_others(sheet, "axis")]
    drag = drag_of(sheet, understood.lead_m)
    lines += ["", "[model]", *_model(mechanics, sheet, drag)]
    for key in ("preload_n", "nut_stiffness_n_per_m", "table_mass_kg"):
        lines.append(_number(key, sheet.get(key), _UNKNOWN[key]))
    lines += _others(sheet, "model")
    if tolerance := _others(sheet, "tolerance"):
        lines += ["", "[tolerance]", *tolerance]
    lines += ["", "[columns]"]
    for channel, choice in understood.columns.items():
        lines += _comments(said, channel)
        if choice != ColumnMap(channel):
            lines.append(f"{channel} = {_column(choice)}")
    lines += [] if mechanics is None else _load(mechanics)
    left = [subject for subject in said if subject not in ("lead_m", *understood.columns)]
    if left:
        lines += ["", "# Not used:", *(line for each in left for line in _comments(said, each))]
    return "\n".join(lines) + "\n"


def _comments(said: Mapping[str, Sequence[Guess]], subject: str) -> list[str]:
    return [
        f"# {subject}: {'(assumed) ' if each.assumed else ''}{each.words.removeprefix('assumed: ')}"
        for each in said.get(subject, ())
    ]


def drag_of(sheet: Mapping[str, float | str], lead_m: float | None) -> Quantity | None:
    """Drag torque of a stated preload (4.3.6), where none is stated; None if it cannot be told."""
    preload_n, diameter_m = sheet.get("preload_n"), sheet.get("screw_diameter_m")
    if "preload_drag_nm" in sheet or not (preload_n and diameter_m and lead_m):
        return None
    drag_nm = preload_drag(float(preload_n), lead_m, lead_angle(lead_m, float(diameter_m)))
    return Quantity(value=float(f"{drag_nm:.3g}"), tolerance=CATALOGUE_TOLERANCE)


def _others(sheet: Sheet, section: str) -> list[str]:
    known = {"lead_m", "inertia_kg_m2", "viscous_nm_s_per_rad", *_UNKNOWN}
    return [
        f"{key} = {_text(value) if isinstance(value, str) else repr(value)}"
        for key, value in sheet.items()
        if SECTIONS[key] == section and key not in known
    ]


def _model(mechanics: Mechanics | None, sheet: Sheet, computed: Quantity | None) -> list[str]:
    given = {key: f"{key} = {sheet[key]!r}  # as given" for key in sheet}
    inertia, viscous = given.get("inertia_kg_m2"), given.get("viscous_nm_s_per_rad")
    drag = given.get("preload_drag_nm")
    if computed is not None:
        value = f"{{ value = {computed.value!r}, tolerance = {computed.tolerance!r} }}"
        drag = f"preload_drag_nm = {value}  # of the preload, by (4.3.6)"
    unknown_drag = _number("preload_drag_nm", None, _UNKNOWN["preload_drag_nm"])
    if mechanics is None:
        inertia = inertia or "# inertia_kg_m2 = ...  # unknown: no torque in N m, or no lead"
        return [inertia, *([viscous] if viscous else []), drag or unknown_drag]
    found, coulomb = mechanics.inertia, mechanics.coulomb
    if inertia is None and found.determined and found.low > 0.0:
        inertia = f"inertia_kg_m2 = {_quantity(found)}  # of motor, screw and table, at the motor"
    elif inertia is None:
        most = mechanics.most_inertia
        inertia = (
            f"inertia_kg_m2 = {{ value = {0.5 * most:.3g}, tolerance = 0.6 }}  # (assumed) half of "
            f"{most:.3g}, with which it would take all of the torque: the recording does not tell"
        )
    if viscous is None and mechanics.viscous.determined and mechanics.viscous.value > 0.0:
        viscous = f"viscous_nm_s_per_rad = {_quantity(mechanics.viscous)}"
    if drag is None and coulomb.determined and coulomb.value > 0.0 and "preload_n" not in sheet:
        drag = f"preload_drag_nm = {_quantity(coulomb)}  # all the dry friction, as recorded"
    return [inertia, *([viscous] if viscous else []), drag or unknown_drag]


def _load(mechanics: Mechanics) -> list[str]:
    """Constant load as an effect, where it is told from zero beside the dry friction."""
    from ..diagnose.candidates.regressors import STEADY  # with all that a diagnosis needs

    load, least_nm = mechanics.offset, _LEAST_LOAD * abs(mechanics.coulomb.value)
    values = f"{{ constant_nm = {load.value:.5g}, asymmetry_nm = 0.0 }}  # as recorded"
    lines = ["", "[[effects]]", f"name = {_text(STEADY)}", f"parameters = {values}"]
    return lines if load.determined and max(load.low, -load.high) > least_nm else []


def _quantity(found: IntervalEstimate) -> str:
    tolerance = min(max(found.sigma / abs(found.value), _LEAST_TOLERANCE), _MOST_TOLERANCE)
    return f"{{ value = {found.value:.5g}, tolerance = {tolerance:.2g} }}"


def _column(choice: ColumnMap) -> str:
    members = [f"column = {_text(choice.column)}", f"scale = {choice.scale!r}"]
    if choice.minus:
        members.append(f"minus = {_text(choice.minus)}")
    if choice.direction:
        members.append(f"direction = {_text(choice.direction)}")
    return "{ " + ", ".join(members) + " }"


def _text(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _number(name: str, value: float | str | None, why: str) -> str:
    return f"# {name} = ...  # {why}" if value is None else f"{name} = {float(value)!r}"
