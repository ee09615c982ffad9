"""An entry of the library, and an entry with its values."""

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

from .contribution import Contribution

Values = Mapping[str, float]
"""Parameter name -> value, for every parameter of an effect."""


class Role(StrEnum):
    """Dependence of the signatures of an effect on a parameter, all others fixed.

    AMOUNT: in proportion, and the effect is gone when all its amounts are 0. PHASE: as
    cos(phase) S(0) + sin(phase) S(pi/2). SHAPE: in no such way, or the effect has no amount.
    """

    AMOUNT = "amount"
    PHASE = "phase"
    SHAPE = "shape"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect.

    Attributes:
        low, high: bounds, both allowed.
        healthy, faulty: typical values; for a shape that a healthy axis shares, equal.
        whole: only whole numbers are allowed.
        amounts: those that a phase or a shape belongs to; empty where it is for all.
    """

    name: str
    unit: str
    description: str
    low: float
    high: float
    healthy: float
    faulty: float
    role: Role = Role.AMOUNT
    whole: bool = False
    amounts: tuple[str, ...] = ()

    def problem(self, value: float) -> str | None:
        """Problem with a value, or None."""
        if not (math.isfinite(value) and self.low <= value <= self.high):
            unit = f" {self.unit}" if self.unit != "1" else ""
            return f"expected {self.low:g} to {self.high:g}{unit}, got {value:g}"
        if self.whole and value != round(value):
            return f"expected a whole number, got {value:g}"
        return None


def phase(
    name: str = "phase_rad", amount: str = "", text: str = "Where in the turn it begins."
) -> Parameter:
    """The phase of a harmonic, of all amounts or of one."""
    amounts = (amount,) if amount else ()
    return Parameter(name, "rad", text, -7.0, 7.0, 0.0, 0.0, Role.PHASE, amounts=amounts)


def order(faulty: float, amount: str = "") -> Parameter:
    """The order of a harmonic: its periods per turn of the screw."""
    text = "Periods per turn of the screw."
    amounts = (amount,) if amount else ()
    return Parameter("order", "1", text, 1, 96, faulty, faulty, Role.SHAPE, True, amounts)


def reference_temperature(*amounts: str) -> Parameter:
    """Parameter of what follows the temperature of the housing, for some amounts."""
    text = "Temperature of the housing at which the model is right."
    return Parameter(
        "reference_c", "degC", text, -50.0, 150.0, 20.0, 20.0, Role.SHAPE, amounts=amounts
    )


def friction_share() -> Parameter:
    """Parameter to locate dry friction, for what follows the load between motor and table."""
    text = "Dry friction of the table, over what the model puts there."
    return Parameter("friction_share", "1", text, 0.0, 1.5, 1.0, 1.0, Role.SHAPE)


def viscous_share() -> Parameter:
    """Parameter to locate viscous friction, for what follows the load between motor and table."""
    text = "Viscous friction that acts on the table, over the whole in the model."
    return Parameter("viscous_share", "1", text, 0.0, 1.5, 0.0, 0.0, Role.SHAPE)


@dataclass(frozen=True, slots=True)
class Effect:
    """One entry of the library.

    Attributes:
        name: as in the machine file and on the command line.
        description: one sentence for a maintenance engineer.
        source: where the equation stands.
        contributions: complete values -> what the effect does.
    """

    name: str
    description: str
    source: str
    parameters: tuple[Parameter, ...]
    contributions: Callable[[Values], tuple[Contribution, ...]]

    def complete(self, given: Values) -> dict[str, float]:
        """Values of all parameters, checked: those given, typical ones for the rest.

        Without any given amount the amounts are those of a typical fault; with one, the amounts
        not given are those of a healthy axis. Other parameters are those of a typical fault.

        Raises:
            ValueError: an unknown parameter, or a value out of its bounds.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        for name, value in given.items():
            if name not in known:
                raise ValueError(f"effect {self.name}: {_unknown(name, known)}")
            problem = known[name].problem(value)
            if problem:
                raise ValueError(f"effect {self.name}: {name}: {problem}")
        amounts = {name for name in known if known[name].role is Role.AMOUNT}
        healthy = amounts if amounts & given.keys() else set()
        return {
            name: given.get(name, each.healthy if name in healthy else each.faulty)
            for name, each in known.items()
        }


def _unknown(name: str, known: Mapping[str, Parameter]) -> str:
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"no parameter {name!r}{hint}; there are {', '.join(known)}"


@dataclass(frozen=True, slots=True)
class ActiveEffect:
    """An effect that is there, with complete values."""

    effect: Effect
    values: Values

    @property
    def contributions(self) -> tuple[Contribution, ...]:
        """Contributions of the effect at its values."""
        return self.effect.contributions(self.values)
