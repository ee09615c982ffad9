"""The page of a diagnosis: plain words first, then numbers and pictures."""

from collections.abc import Callable, Mapping, Sequence

from ...diagnose.localisation.places import Place
from ...diagnose.pipeline import Diagnosis, NamedEffect, Verdict
from ...diagnose.session.data_check import DataCheck
from ...diagnose.session.session import Session
from ...diagnose.validation.shrink import Shrink
from ...models.effects.registry import get_effect
from ...models.machine import Machine
from .diagnosis_document import withheld
from .diagnosis_figures import LABELS, draw_gaps, draw_replays, draw_waterfalls
from .page import rendered
from .quantities import amount, interval, percent, words

VERDICTS = {
    "no_gap": "Machine and model agree. Nothing was found that matters.",
    "explained": "The difference between machine and model has a clear cause.",
    "ambiguous": "This recording alone cannot decide what causes the difference.",
    "unknown": "There is a difference that no known effect explains.",
}
BLIND = "This recording cannot answer the question: its noise would hide any difference."
CHANNELS = {"torque_nm": "torque", "transmission_m": "position between motor and table"}
FLOORS = {
    "recording": "what neither this motion nor a repeat of it can predict, in this recording",
    "reference": "the difference that remains between healthy recordings",
}


def render(
    machine: Machine,
    names: Sequence[str],
    session: Session,
    found: Diagnosis,
    check: DataCheck,
    unobservable: Mapping[str, str],
    reference: Sequence[str] = (),
) -> str:
    """The page as HTML; nothing in it is loaded from elsewhere.

    Args:
        reference: names of the recordings of the healthy machine.
    """
    telling = _telling(found)
    claimed = sorted({each.channel for each in found.effects} & found.replay.gap.keys())
    accepted = bool(found.effects) and found.verdict is not Verdict.UNKNOWN
    return _page(
        machine=machine,
        names=names,
        reference=reference,
        found=found,
        lead=BLIND if found.is_blind else VERDICTS[found.verdict.value],
        faults=(),
        remarks=check.remarks,
        unobservable=_by_reason(unobservable),
        quiet=[CHANNELS[name] for name in found.gap if name not in telling],
        tolerated=[CHANNELS[name] for name, each in found.gap.items() if each.matters],
        named=_by_weight(found.effects) if accepted else found.effects[:1],
        shown=claimed,
        accepted=accepted,
        withheld=withheld(found),
        waterfalls=draw_waterfalls(found, telling if accepted else ()),
        replays=draw_replays(found, claimed if accepted else ()),
        gaps=draw_gaps(session, found, telling),
    )


def _by_reason(unobservable: Mapping[str, str]) -> dict[str, list[str]]:
    """Names of the effects that could not be judged for each reason."""
    found: dict[str, list[str]] = {}
    for name, reason in unobservable.items():
        found.setdefault(reason, []).append(name)
    return found


def _by_weight(named: Sequence[NamedEffect]) -> list[NamedEffect]:
    """The surest first; of those that are as sure, the one that makes most of the difference."""
    return sorted(named, key=_weight)


def _weight(each: NamedEffect) -> tuple[bool, float, float]:
    """A fault comes first."""
    is_fault = get_effect(each.name).is_fault
    return not is_fault, -round(each.probability, 1), -each.shrink.estimate


def _telling(found: Diagnosis) -> list[str]:
    """Channels whose gap matters, or that an effect is named in."""
    claimed = {each.channel for each in found.effects}
    return [name for name, gap in found.gap.items() if name in claimed or gap.matters]


def render_bad_data(machine: Machine, names: Sequence[str], check: DataCheck) -> str:
    """The page where the data forbid a diagnosis."""
    return _page(
        machine=machine,
        names=names,
        reference=(),
        found=None,
        lead="The recording cannot be diagnosed.",
        faults=check.faults,
        remarks=check.remarks,
        unobservable={},
        quiet=(),
        tolerated=(),
        named=(),
        shown=(),
        accepted=False,
        withheld=(),
        waterfalls={},
        replays={},
        gaps={},
    )


def _page(**content: object) -> str:
    filters: dict[str, Callable[..., object]] = {
        "shown": interval,
        "percent": percent,
        "points": points,
        "words": words,
        "sure": sure,
        "amount": amount,
        "quantity": quantity,
        "places": places,
    }
    return rendered(
        "diagnosis.html",
        filters,
        **content,
        channels=CHANNELS,
        labels=LABELS,
        floors=FLOORS,
        describe=lambda n: get_effect(n).description,
    )


def sure(probability: float) -> str:
    """Confidence in words that never say certain.

    >>> sure(0.9999), sure(0.75)
    ('more than 99 % sure', '75 % sure')
    """
    return "more than 99 % sure" if probability > 0.99 else f"{percent(probability)} sure"


def quantity(effect: str, parameter: str) -> str:
    """Description of a parameter, as its effect gives it.

    >>> quantity("backlash", "width_m")
    'Clearance'
    """
    described = next(p for p in get_effect(effect).parameters if p.name == parameter)
    return described.description.rstrip(".")


def points(value: Shrink) -> str:
    """A shrink with its interval.

    >>> points(Shrink(0.802, 0.67, 0.904))
    '80 % (67 to 90)'
    """
    low, high = round(100.0 * value.low), round(100.0 * value.high)
    return f"{percent(value.estimate)} ({low} to {high})"


def places(found: Sequence[Place]) -> list[str]:
    """Location of a gap, a sentence for each variable.

    >>> spans = (Place("torque_nm", "motor_speed_rad_s", *ends, "rad/s", 0.71, 0.8, 0.01)
    ...          for ends in ((-5.02, 1.5), (800.0, 1260.4)))
    >>> places(list(spans))
    ['Torque: 71 % of the difference follows the motor speed, -5.02 to 1.5, 800 to 1260 rad/s.']
    """
    spans: dict[tuple[str, str], list[Place]] = {}
    for each in found:
        spans.setdefault((each.channel, each.variable), []).append(each)
    return [
        f"{CHANNELS[channel].capitalize()}: {percent(mine[0].share)} of the difference "
        f"follows the {_over(variable, mine)}."
        for (channel, variable), mine in spans.items()
    ]


def _over(variable: str, mine: Sequence[Place]) -> str:
    name, _, unit = LABELS[variable].partition(", ")
    if variable == "direction":
        ways = {(0.0, 1.0): ", most of it forwards", (-1.0, 0.0): ", most of it backwards"}
        return name + ways.get((mine[0].low, mine[0].high), "")
    ranges = ", ".join(f"{_plain(each.low)} to {_plain(each.high)}" for each in mine)
    return f"{name}, {ranges} {unit}"


def _plain(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
