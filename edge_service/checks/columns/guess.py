"""Guesses about a machine that nobody has described, each with its reason."""

from dataclasses import dataclass, field, replace

from ...messages.samples import ColumnMap


@dataclass(frozen=True, slots=True)
class Guess:
    """One thing that was found, or assumed."""

    subject: str  # a key of the machine file, or what else it is about
    words: str  # what, and why, in one line
    assumed: bool = False  # nothing in the recordings says so; the owner should look at it


@dataclass(frozen=True, slots=True)
class Question:
    """One thing that recordings cannot tell."""

    option: str  # of the command, which answers it
    words: str  # question with its unit
    why: str  # what cannot be answered without


@dataclass(frozen=True, slots=True)
class Known:
    """Statements of the owner; None where nothing is said."""

    lead_m: float | None = None  # travel of the table per revolution of the motor
    # N m at the motor per A, or per unit of the column that tells the torque
    torque_constant: float | None = None
    period_s: float | None = None  # of the samples, where no column holds the time

    def answered(self, question: Question, value: float | None) -> "Known":
        """The same with the answer to a question; the lead is asked for in mm."""
        if question.option == "--lead":
            return replace(self, lead_m=None if value is None else 1e-3 * value)
        name = "period_s" if question.option == "--period" else "torque_constant"
        return replace(self, **{name: value})


@dataclass(slots=True)
class Understanding:
    """The columns of one axis as they are understood."""

    columns: dict[str, ColumnMap] = field(default_factory=dict)
    guesses: list[Guess] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    lead_m: float | None = None

    def say(self, subject: str, words: str, *, assumed: bool = False) -> None:
        self.guesses.append(Guess(subject, words, assumed))

    def ask(self, option: str, words: str, why: str) -> None:
        """Add a question, once."""
        question = Question(option, words, why)
        if question not in self.questions:
            self.questions.append(question)
