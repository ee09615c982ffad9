"""The proposed machine file as text: what was found, with the reason beside each line."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

from ...checks.columns.guess import Choice, Guess, Question, Understanding
from ...checks.columns.mechanics import Mechanics
from ...regression.interval_estimate import IntervalEstimate

_LEAST_TOLERANCE, _MOST_TOLERANCE = 1e-4, 10.0


@dataclass(frozen=True, slots=True)
class DataSheet:
    """Figures that no recording holds; None where the owner has not said it."""

    name: str = "X"
    number: int | None = None
    dynamic_load_rating_n: float | None = None
    preload_n: float | None = None
    preload_drag_nm: float | None = None
    nut_stiffness_n_per_m: float | None = None
    table_mass_kg: float | None = None

    def asked(self, ask: Callable[[Question], float | None] | None) -> "DataSheet":
        """The sheet with what whoever is at the terminal knows of it; as it is without `ask`."""
        if ask is None:
            return self
        missing = [name for name in SHEET_QUESTIONS if getattr(self, name) is None]
        said = {name: ask(SHEET_QUESTIONS[name]) for name in missing}
        return DataSheet(**{**asdict(self), **said})


_UNKNOWN = {
    "dynamic_load_rating_n": "the screw's data sheet; without it there is no preload in percent",
    "preload_n": "the screw's data sheet; preload of the fresh screw",
    "preload_drag_nm": "the fresh screw's own drag; the data sheet has it, or 5.3.11 of the thesis",
    "nut_stiffness_n_per_m": "the nut's data sheet; without it intervals are wider",
    "table_mass_kg": "the table with what is on it; without it, it is guessed to 50 %",
}
SHEET_QUESTIONS = {
    "dynamic_load_rating_n": Question(
        "--load-rating", "Dynamic load rating of the screw, N", "preload in percent"
    ),
    "preload_n": Question("--preload", "Preload of the fresh screw, N", "preload in percent"),
    "nut_stiffness_n_per_m": Question("--nut-stiffness", "Stiffness of the nut, N/m", "intervals"),
    "table_mass_kg": Question(
        "--table-mass", "Mass of the table with what is on it, kg", "intervals, friction of guides"
    ),
}
"""Key of the machine file -> what a person is asked for."""


def machine_text(
    files: Sequence[str],
    understood: Understanding,
    mechanics: Mechanics | None,
    sheet: DataSheet,
    stroke_m: float | None,
) -> str:
    """The machine file; lines that nothing is known for stand in it as comments."""
    said = _said(understood.guesses)
    lines = [
        f"# Proposed by `edge-service adopt` from {', '.join(files)}.",
        "# Each line has its reason; look first at those that are assumed.",
        "",
        "[axis]",
        f'name = "{sheet.name}"',
    ]
    if sheet.number is not None:
        lines.append(f"number = {sheet.number}  # the controller's number of the axis")
    lines += [*_comments(said, "lead_m"), _number("lead_m", understood.lead_m, "unknown: --lead")]
    if stroke_m is not None:
        lines.append(f"# stroke_m = ...  # at least {stroke_m:.4g} m, over which it was recorded")
    lines += [_of_sheet(sheet, "dynamic_load_rating_n"), "", "[model]"]
    lines += _model(mechanics, sheet)
    stated = ("preload_n", "nut_stiffness_n_per_m", "table_mass_kg")
    lines += [_of_sheet(sheet, name) for name in stated]
    lines += ["", "[columns]"]
    for channel, choice in understood.columns.items():
        lines += _comments(said, channel)
        if not choice.is_plain(channel):
            lines.append(f"{channel} = {_column(choice)}")
    left = [name for name in said if name not in ("lead_m", *understood.columns)]
    if left:
        lines += ["", "# Not used:", *(line for name in left for line in _comments(said, name))]
    return "\n".join(lines) + "\n"


def _said(guesses: Sequence[Guess]) -> dict[str, list[Guess]]:
    said: dict[str, list[Guess]] = {}
    for guess in guesses:
        said.setdefault(guess.subject, []).append(guess)
    return said


def _comments(said: Mapping[str, Sequence[Guess]], subject: str) -> list[str]:
    return [
        f"# {subject}: {'(assumed) ' if each.assumed else ''}{each.words.removeprefix('assumed: ')}"
        for each in said.get(subject, ())
    ]


def _model(mechanics: Mechanics | None, sheet: DataSheet) -> list[str]:
    drag = _of_sheet(sheet, "preload_drag_nm")
    if mechanics is None:
        return ["# inertia_kg_m2 = ...  # unknown: no torque in N m, or no lead", drag]
    inertia, viscous, coulomb = mechanics.inertia, mechanics.viscous, mechanics.coulomb
    if inertia.determined and inertia.low > 0.0:
        said = f"{_quantity(inertia)}  # of motor, screw and table, at the motor"
    else:
        most = mechanics.most_inertia
        said = (
            f"{{ value = {0.5 * most:.3g}, tolerance = 0.6 }}  # (assumed) half of {most:.3g}, "
            "with which it would take all of the torque: the recording does not tell"
        )
    lines = [f"inertia_kg_m2 = {said}"]
    if viscous.determined and viscous.value > 0.0:
        lines.append(f"viscous_nm_s_per_rad = {_quantity(viscous)}")
    if sheet.preload_drag_nm is not None:
        drag = f"preload_drag_nm = {sheet.preload_drag_nm!r}  # as given"
    elif coulomb.determined and coulomb.value > 0.0 and sheet.preload_n is None:
        why = "all dry friction of the axis, as recorded"
        drag = f"preload_drag_nm = {_quantity(coulomb)}  # {why}"
    return [*lines, drag]


def _quantity(found: IntervalEstimate) -> str:
    tolerance = min(max(found.sigma / abs(found.value), _LEAST_TOLERANCE), _MOST_TOLERANCE)
    return f"{{ value = {found.value:.5g}, tolerance = {tolerance:.2g} }}"


def _column(choice: Choice) -> str:
    members = [f"column = {_text(choice.column)}", f"scale = {choice.scale!r}"]
    if choice.minus:
        members.append(f"minus = {_text(choice.minus)}")
    if choice.direction:
        members.append(f"direction = {_text(choice.direction)}")
    return "{ " + ", ".join(members) + " }"


def _text(text: str) -> str:
    """A TOML string."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _of_sheet(sheet: DataSheet, name: str) -> str:
    value = getattr(sheet, name)
    return _number(name, value, _UNKNOWN[name])


def _number(name: str, value: float | None, why: str) -> str:
    return f"# {name} = ...  # {why}" if value is None else f"{name} = {float(value)!r}"
