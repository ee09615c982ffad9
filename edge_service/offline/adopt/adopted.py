"""Answer of `adopt`: how the recordings were understood, in words and as a document."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from ...checks.columns.guess import Guess, Question, Understanding
from ...checks.columns.mechanics import Ability, Mechanics
from ...checks.finding import Finding
from ...command_answer import Answer
from ...messages.arrays import finite_or_none
from ...regression.interval_estimate import IntervalEstimate
from ..document import Document


class Found(Document):
    """A parameter with its 95 % interval in `unit`; null where it is not determined."""

    name: str
    value: float | None
    low: float | None
    high: float | None
    unit: str

    def as_text(self) -> str:
        """One line."""
        if self.value is None:
            return f"{self.name}: not determined"
        interval = f"{self.low:.3g} to {self.high:.3g}"
        return f"{self.name}: {self.value:.4g} {self.unit} ({interval})"


class Doubt(Document):
    """A check of the machine file against the recordings that raised a doubt."""

    name: str
    sentence: str


class Adopted(Document):
    """Machine file of recordings; it was not examined where `checks` is null.

    Attributes:
        motion_s: motion behind what was found; null where nothing was.
        able: what these recordings answer; an empty reason stands for yes.
    """

    out: str
    understood: list[Guess]
    unknown: list[Question]
    motion_s: float | None
    found: list[Found]
    checks: int | None
    doubts: list[Doubt]
    able: list[Ability]
    picture: str | None


def answer_of(
    out: Path,
    picture: Path | None,
    understood: Understanding,
    mechanics: Mechanics | None,
    findings: Sequence[Finding] | None,
    able: Sequence[Ability],
) -> Answer:
    """Words and document; without findings nothing could be examined."""
    doubtful = [each for each in findings or () if each.is_doubtful]
    adopted = Adopted(
        out=str(out),
        understood=list(understood.guesses),
        unknown=list(understood.questions),
        motion_s=None if mechanics is None else mechanics.seconds,
        found=[] if mechanics is None else _found(mechanics),
        checks=None if findings is None else len(findings),
        doubts=[Doubt(name=each.name, sentence=each.sentence) for each in doubtful],
        able=list(able),
        picture=None if picture is None else str(picture),
    )
    return Answer("\n".join(_lines(adopted)), adopted)


def _found(mechanics: Mechanics) -> list[Found]:
    return [
        _parameter("inertia", mechanics.inertia),
        _parameter("dry friction", mechanics.coulomb),
        _parameter("viscous friction", mechanics.viscous),
        _parameter("constant load", mechanics.offset),
    ]


def _parameter(name: str, each: IntervalEstimate) -> Found:
    known = finite_or_none if each.determined else lambda _value: None
    return Found(
        name=name,
        value=known(each.value),
        low=known(each.low),
        high=known(each.high),
        unit=each.unit,
    )


def _lines(adopted: Adopted) -> Iterator[str]:
    yield f"{adopted.out}: written"
    yield "understood:"
    for guess in adopted.understood:
        mark = "assumed" if guess.assumed else ""
        yield f"  {mark:<8}{guess.subject}: {guess.words.removeprefix('assumed: ')}"
    for question in adopted.unknown:
        yield f"  unknown {question.option}: {question.words} ({question.why})"
    if adopted.motion_s is not None:
        yield f"found, from {adopted.motion_s:.3g} s of motion (95 %):"
        yield from (f"  {each.as_text()}" for each in adopted.found)
    yield from _examined(adopted)
    yield "these recordings answer:"
    yield from (f"  {each.as_text()}" for each in adopted.able)
    if adopted.picture is not None:
        yield f"{adopted.picture}: the channels as they were understood"


def _examined(adopted: Adopted) -> Iterator[str]:
    if adopted.checks is None:
        missing = "the machine file is incomplete: lead_m or inertia_kg_m2 is missing"
        yield f"not examined: {missing}"
        return
    yield f"examined: {adopted.checks} checks, {len(adopted.doubts)} of them doubtful"
    yield from (f"  {each.name}: {each.sentence}" for each in adopted.doubts)
