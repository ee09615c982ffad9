"""An entry of the library, and an entry with its values."""

import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from .baseline import Baseline
from .contribution import Contribution, Harmonic
from .empirical import Covered, EmpiricalForm

Values = Mapping[str, float]
"""Parameter name -> value, for every parameter of an effect."""
ACCELERATION_HZ = 200.0
"""Below this sampling rate accelerations come and go between two samples."""
MATERIAL_TOLERANCES = 3.0  # a parameter that is off by more tolerances than this is a cause
MOST_ORDER = 96
"""Highest order of a harmonic: its periods per turn of the screw."""


class Kind(StrEnum):
    """Part of the axis, or of its surroundings, that an effect belongs to."""

    FRICTION = "friction"
    LOAD = "load"  # that the motor moves or holds
    DRIVE = "drive"  # between the torque command and the torque
    LOST_MOTION = "lost motion"  # ISO 230-1: play or spring, that give between motor and table
    TRAVEL = "travel"  # ISO 3408-3: the screw carries the table too far, or not far enough
    MEASUREMENT = "measurement"  # of an encoder
    DISTURBANCE = "disturbance"  # a force on the table for a while, that nothing foretells


class Term(StrEnum):
    """Constant of the baseline model, in the order of its torque balance; gain and lag are last."""

    INERTIA = "inertia"
    VISCOUS = "viscous"
    COULOMB = "coulomb"
    GAIN = "gain"
    LAG = "lag"


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
    name: str
    unit: str
    description: str
    low: float  # bounds, both allowed
    high: float
    healthy: float  # typical values; equal for a shape that a healthy axis shares
    faulty: float
    role: Role = Role.AMOUNT
    whole: bool = False  # only whole numbers are allowed
    amounts: tuple[str, ...] = ()  # those that a phase or a shape belongs to; empty: all
    # values of a shape from which a search begins; empty: those that its unit suggests, of a place
    # along the travel, whose name begins with `centre`, all of that travel
    tried: tuple[float, ...] = ()
    # the same as shares of the travel that a recording covers
    tried_of_travel: tuple[float, ...] = ()

    def problem(self, value: float) -> str | None:
        """Problem with a value, or None."""
        if not (math.isfinite(value) and self.low <= value <= self.high):
            unit = f" {self.unit}" if self.unit != "1" else ""
            return f"expected {self.low:g} to {self.high:g}{unit}, got {value:g}"
        if self.whole and value != round(value):
            return f"expected a whole number, got {value:g}"
        return None


def amount(
    name: str, unit: str, description: str, low: float, high: float, faulty: float
) -> Parameter:
    """Strength of an effect, which a healthy axis has none of."""
    return Parameter(name, unit, description, low, high, 0.0, faulty)


def shape(
    name: str,
    unit: str,
    description: str,
    low: float,
    high: float,
    usual: float,
    amounts: tuple[str, ...] = (),
    tried: tuple[float, ...] = (),
    tried_of_travel: tuple[float, ...] = (),
) -> Parameter:
    """Shape of an effect that a healthy axis shares; see Parameter."""
    given = (usual, usual, Role.SHAPE, False, amounts, tried, tried_of_travel)
    return Parameter(name, unit, description, low, high, *given)


def phase(
    name: str = "phase_rad", amount: str = "", text: str = "Where in the turn it begins."
) -> Parameter:
    """The phase of a harmonic, of all amounts or of one."""
    amounts = (amount,) if amount else ()
    return Parameter(name, "rad", text, -7.0, 7.0, 0.0, 0.0, Role.PHASE, amounts=amounts)


def order(faulty: float, amount: str = "", most: int = MOST_ORDER) -> Parameter:
    """The order of a harmonic: its periods per turn of the screw; up to `most` are tried."""
    text, amounts = "Periods per turn of the screw.", (amount,) if amount else ()
    tried = tuple(float(each) for each in range(1, most + 1))
    given = (faulty, faulty, Role.SHAPE, True, amounts, tried)
    return Parameter("order", "1", text, 1, MOST_ORDER, *given)


def harmonic(values: Values, amplitude: str) -> Harmonic:
    """Curve over the angle with the parameters `amplitude`, `order` and `phase_rad`."""
    return Harmonic(values[amplitude], values["order"], values["phase_rad"])


def reference_temperature(*amounts: str) -> Parameter:
    """Parameter of what follows the temperature of the housing, for some amounts."""
    text = "Temperature of the housing at which the model is right."
    return shape("reference_c", "degC", text, -50.0, 150.0, 20.0, amounts)


def friction_share(*tried: float, most: float = 1.5) -> Parameter:
    """Parameter to locate dry friction, for what follows the load; the nut's may be part of it."""
    text = "Dry friction of the table, over what the model puts there."
    steps = tried or (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.3)
    return shape("friction_share", "1", text, 0.0, most, 1.0, tried=steps)


def viscous_share(*tried: float) -> Parameter:
    """Parameter to locate viscous friction, for what follows the load between motor and table."""
    text = "Viscous friction that acts on the table, over the whole in the model."
    return shape("viscous_share", "1", text, 0.0, 1.5, 0.0, tried=tried or (0.0, 0.4, 0.8, 1.2))


@dataclass(frozen=True, slots=True)
class Trace:
    """Part of an effect that even a healthy axis has."""

    # sampling period, s, and Coulomb level, N m -> mean and standard deviation of the amount at the
    # values `shape`; of the share of the effect where it has no amount
    prior: Callable[[float, float], tuple[float, float]] | None = None
    shape: Values = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Confirmation:
    """A check of the plausibility of recordings that sees an effect by itself."""

    check: str  # name of its finding
    resembled_by: tuple[Kind, ...]  # kinds of the effects that a diagnosis may name in its place


@dataclass(frozen=True, slots=True)
class Effect:
    """One entry of the library."""

    name: str  # as in the machine file and on the command line
    description: str  # one sentence for a maintenance engineer
    source: str  # where the equation stands
    kind: Kind
    parameters: tuple[Parameter, ...]
    contributions: Callable[[Values], tuple[Contribution, ...]]  # of complete values
    term: Term | None = None  # constant of the baseline model that it is an error of
    is_thermal: bool = False  # it follows heat, where motion heats an axis in places of its own
    # its signature holds the measured torque, and would explain that at any strength but its own
    follows_own_torque: bool = False
    # its shapes say what loads it: the difference of two loads could be any
    has_one_load: bool = False
    rests_anywhere: bool = False  # it lies where a stop throws it, which nothing foretells
    least_rate_hz: float = 0.0  # of samples, below which it comes and goes between them
    # effects that it resembles in what their few numbers leave of them. Beside a greater one of
    # these it is a cause only where it adds much, or leaves nothing
    imitates: frozenset[str] = frozenset()
    # most_shapes, most_entries: times that it may be there in shapes of its own, and in a machine
    # file: sums of many could be anything
    most_shapes: int = 4
    most_entries: int = 4
    trace: Trace = Trace()
    confirmation: Confirmation | None = None
    # forms that it takes on a real axis beyond those of its parameters
    empirical_forms: Callable[[Covered, Baseline], Iterator[EmpiricalForm]] = lambda *_: iter(())
    # no model is to learn it, and no search finds it: it is told from what is known of the fresh
    # machine
    is_fault: bool = False

    def complete(self, given: Values) -> dict[str, float]:
        """Values of all parameters, checked: those given, typical ones for the rest.

        Without any given amount the amounts are those of a typical fault; with one, the amounts
        not given are those of a healthy axis. Other parameters are those of a typical fault.

        Raises ValueError: an unknown parameter, or a value out of its bounds.
        """
        known = {parameter.name: parameter for parameter in self.parameters}
        for name, value in given.items():
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ValueError(
                    f"effect {self.name}: no parameter {name!r}{hint}; there are {', '.join(known)}"
                )
            problem = known[name].problem(value)
            if problem:
                raise ValueError(f"effect {self.name}: {name}: {problem}")
        amounts = {name for name in known if known[name].role is Role.AMOUNT}
        healthy = amounts if amounts & given.keys() else set()
        return {
            name: given.get(name, each.healthy if name in healthy else each.faulty)
            for name, each in known.items()
        }


@dataclass(frozen=True, slots=True)
class ActiveEffect:
    """An effect that is there, with complete values."""

    effect: Effect
    values: Values

    @property
    def contributions(self) -> tuple[Contribution, ...]:
        """Contributions of the effect at its values."""
        return self.effect.contributions(self.values)
