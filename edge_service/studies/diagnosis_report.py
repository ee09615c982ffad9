"""The page of a diagnosis: plain words first, then numbers and pictures."""

from collections.abc import Sequence
from importlib.resources import files

from jinja2 import Environment, StrictUndefined

from ..diagnose.data_check import DataCheck
from ..diagnose.diagnosis import Diagnosis
from ..diagnose.session import Session
from ..diagnose.values import Interval
from ..models.effects.registry import get_effect
from ..models.machine import Machine
from .diagnosis_figures import LABELS, draw_gaps, draw_waterfalls

VERDICTS = {
    "no_gap": "Machine and model agree. Nothing was found that matters.",
    "explained": "The difference between machine and model has a clear cause.",
    "ambiguous": "The difference has a cause that this recording alone cannot pin down.",
    "unknown": "There is a difference that none of the known effects explains.",
}
CHANNELS = {"torque_nm": "torque", "transmission_m": "position between motor and table"}
_SHOWN_UNITS = {"m": ("µm", 1e6), "s": ("ms", 1e3), "1": ("", 1.0)}


def render(
    machine: Machine,
    names: Sequence[str],
    session: Session,
    found: Diagnosis,
    check: DataCheck,
    not_judged: Sequence[str],
) -> str:
    """The page as HTML; nothing in it is loaded from elsewhere."""
    return _page(
        machine=machine,
        names=names,
        found=found,
        lead=VERDICTS[found.verdict.value],
        faults=(),
        remarks=check.remarks,
        not_judged=not_judged,
        waterfalls=draw_waterfalls(found),
        gaps=draw_gaps(session, found),
    )


def render_bad_data(machine: Machine, names: Sequence[str], check: DataCheck) -> str:
    """The page where the data forbid a diagnosis."""
    return _page(
        machine=machine,
        names=names,
        found=None,
        lead="The recording cannot be diagnosed.",
        faults=check.faults,
        remarks=check.remarks,
        not_judged=(),
        waterfalls={},
        gaps={},
    )


def _page(**content: object) -> str:
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    environment.filters.update(
        shown=shown, percent=percent, words=words, sure=sure, amount=amount, quantity=quantity
    )
    source = files(__package__).joinpath("templates/diagnosis.html").read_text("utf-8")
    return environment.from_string(source).render(
        **content, channels=CHANNELS, labels=LABELS, describe=lambda n: get_effect(n).description
    )


def shown(value: Interval) -> str:
    """Value and interval in a handy unit."""
    unit, factor = _SHOWN_UNITS.get(value.unit, (value.unit, 1.0))
    if value.unit == "m" and abs(value.value) >= 1e-3:
        unit, factor = "mm", 1e3
    elif value.unit == "s" and abs(value.value) >= 0.1:
        unit, factor = value.unit, 1.0
    low, middle, high = (factor * each for each in (value.low, value.value, value.high))
    return f"{middle:.3g} {unit} ({low:.3g} to {high:.3g})".replace("  ", " ")


def amount(value: float, unit: str) -> str:
    """A value in a handy unit.

    >>> amount(7.22e-7, "m")
    '0.722 µm'
    """
    shown_unit, factor = _SHOWN_UNITS.get(unit, (unit, 1.0))
    return f"{factor * value:.3g} {shown_unit}"


def sure(probability: float) -> str:
    """How sure, in words that never say certain.

    >>> sure(0.9999), sure(0.75)
    ('more than 99 % sure', '75 % sure')
    """
    return "more than 99 % sure" if probability > 0.99 else f"{percent(probability)} sure"


def quantity(effect: str, parameter: str) -> str:
    """What a parameter is, as its effect describes it.

    >>> quantity("backlash", "width_m")
    'Clearance'
    """
    described = next(p for p in get_effect(effect).parameters if p.name == parameter)
    return described.description.rstrip(".")


def percent(share: float) -> str:
    """A share in whole percent."""
    return f"{100.0 * share:.0f} %"


def words(name: str) -> str:
    """A name without its underscores.

    >>> words("load_offset")
    'load offset'
    """
    return name.replace("_", " ")
