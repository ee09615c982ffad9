"""Meaning of a column's name: quantity, unit and axis, as loggers and controllers spell them.

The words are those of SINUMERIK servo data and Industrial Edge (`recordings/sinumerik`), of joint
states in ROS, and those of `words.toml`, which data loggers and laboratories write.
"""

import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib.resources import files
from string import digits

from ...messages.samples import CHANNELS, SI, units_spelled
from ...recordings.sinumerik.signals import (
    EDGE_SIGNALS,
    SINUMERIK_SIGNALS,
    edge_signals,
    sinumerik_signal,
)

_LETTERS = str.maketrans("łŁøØı", "lLoOi")  # are not made of a letter and its accent


def _unaccented(text: str) -> str:
    parts = unicodedata.normalize("NFKD", text.translate(_LETTERS))
    return "".join(part for part in parts if not unicodedata.combining(part))


class Quantity(StrEnum):
    """Kinds of values that a column holds."""

    TIME = "time"
    COUNTER = "counter of samples"
    SETPOINT = "position set point"
    MOTOR_POSITION = "position of the motor"
    TABLE_POSITION = "position of the table"
    POSITION = "position"
    POSITION_ERROR = "position error"
    MOTOR_SPEED = "speed of the motor"
    SPEED = "speed"
    COMMANDED_SPEED = "commanded speed"
    TORQUE = "torque"
    CURRENT = "current"
    TEMPERATURE = "temperature"
    FORCE = "force"
    OTHER = "something else"
    UNNAMED = "unnamed"


@dataclass(frozen=True, slots=True)
class ColumnName:
    """Meaning of one name."""

    name: str
    quantity: Quantity
    unit: str = ""  # as `messages/units.toml` writes it; empty where the name gives none
    axis: str = ""  # of the controller, as the name spells it; empty where it names none
    rank: int = 0  # the smaller, the better a column of the same quantity serves
    stranger: str = ""  # what stands where a unit stands, and is none that is known
    is_given: bool = False  # its owner says what it holds

    @property
    def why(self) -> str:
        return "as given" if self.is_given else "by its name"

    @property
    def is_position(self) -> bool:
        return self.quantity.name.endswith("POSITION")

    @property
    def si_unit(self) -> str:
        """SI unit of what it measures; empty where the name gives no unit of that kind."""
        return SI.get(self.unit, (0.0, ""))[1]


_TABLE = tomllib.loads((files(__package__) / "words.toml").read_text("utf-8"))
_KINDS = {name: frozenset(text.split()) for name, text in _TABLE.pop("kinds").items()}
_SUITED = {Quantity[name.upper()]: units for name, units in _TABLE.pop("suited").items()}
_CANONICAL = {
    name: (Quantity[quantity.upper()], CHANNELS[name].unit if name in CHANNELS else "s")
    for name, quantity in _TABLE.pop("channels").items()
}
_FOREIGN = {own: meant for words in _TABLE.values() for own, meant in words.items()}
_COMMAND, _MOTOR, _TABLE_SIDE = _KINDS["command"], _KINDS["motor"], _KINDS["table"]
_POSITION, _SPEED = _KINDS["position"], _KINDS["speed"]
_SIMPLE = [(each, _KINDS[each.name.lower()]) for each in list(_SUITED)[:6]]
_VOCABULARY = frozenset(_TABLE["german"]).union(*_KINDS.values())
_REMARKS = _VOCABULARY - _KINDS["counter"] | {""}
_LEAST_PART = 4
_BRACKET = re.compile(r"\s*[\[(（【]\s*([^\])）】]*?)\s*[\])）】]")
_BEHIND = re.compile(r"\s*(?:/|,|\bin\b)\s*([^\s/,]+(?: [^\s/,]{1,3})?)$")
_SUFFIX = re.compile(r"_(mm_min|m_min|mm_s|rad_s|deg_s|rev_min|m_s|[A-Za-z%°µ]+)$")
_NUMBER = re.compile(r" #\d+$")
_ALSO_WORDS = ("in", "ft", "mil", "min", "h", "d", "count")
"""Units that end a name for other reasons, too."""
_PREFIX_AXIS = re.compile(r"^([XYZABCUVWSQ]\d?|[Aa]x(?:is)?_?\d+|[Aa]xis_?[A-Za-z]\d?)[_./ :]")
_AXIS_END = re.compile(rf"[_./ :]([XYZABCUVW]\d?|[Aa]x(?:is)?_?\d+)(?=(?:{_BRACKET.pattern})?\s*$)")
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+\d?|[A-Z]+\d?|\d+(?:st|nd)|#\d+")
_NUMBERED = re.compile(r"#?\d+|col(?:umn)?_?\d+|ch(?:annel)?_?\d+|", re.IGNORECASE)

_CONTROLLER = {
    short: (Quantity.CURRENT if "curr" in short.lower() else _CANONICAL[channel][0], rank)
    for signals in (SINUMERIK_SIGNALS, EDGE_SIGNALS)
    for channel, shorts in signals.items()
    for rank, short in enumerate(shorts)
}

_OTHERS = (Quantity.CURRENT, Quantity.POSITION_ERROR, Quantity.COUNTER, Quantity.OTHER)
QUANTITIES = {channel: quantity for channel, (quantity, _) in _CANONICAL.items()}
QUANTITIES |= {each.name.lower(): each for each in _OTHERS}
"""Word for a quantity on the command line -> quantity."""


def unit_of(text: str, quantity: Quantity = Quantity.OTHER) -> str:
    """A unit as it is written here, of those that suit; empty for one that is not known."""
    able = units_spelled(text)
    return next((unit for unit in able if suits(unit, quantity)), able[-1] if able else "")


def units_below(names: Sequence[str], rows: Sequence[Sequence[str]]) -> dict[str, str]:
    for texts in ([cell.strip("[]() ") for cell in row] for row in rows):
        if 2 * sum(bool(units_spelled(text)) for text in texts) > sum(map(bool, texts)):
            return dict(zip(names, texts, strict=False))
    return {}


def suits(unit: str, quantity: Quantity) -> bool:
    """Unit, or none, that such a quantity may have; anything suits what no name tells."""
    return not unit or SI[unit][1] in _SUITED.get(quantity, (SI[unit][1],))


def column_names(names: Sequence[str], units: Mapping[str, str] = {}) -> list[ColumnName]:
    """Meaning of every name of a file, in its order; `units` stand below them."""
    controller, axes = _controller_names(names), dict[str, str]()
    for name in names:
        if match := _PREFIX_AXIS.search(name) or _AXIS_END.search(name):
            axes[name] = match[1]
    often = Counter(axes.values())  # a letter that only one name has is none
    axes = {name: axis for name, axis in axes.items() if often[axis] > 1}
    return [
        controller.get(name) or _plain_name(name, axes.get(name, ""), units.get(name, ""))
        for name in names
    ]


def _controller_names(names: Sequence[str]) -> dict[str, ColumnName]:
    """Names of SINUMERIK traces and Industrial Edge, whose axis stands in them."""
    edge = {each.column: each for each in edge_signals(names)}
    found = {}
    for name in names:
        signal = edge.get(name) or sinumerik_signal(name, "")
        if signal is not None:
            quantity, rank = _CONTROLLER.get(signal.short, (Quantity.OTHER, 0))
            found[name] = ColumnName(name, quantity, signal.unit or "", str(signal.axis), rank)
    return found


def _plain_name(name: str, axis: str, below: str) -> ColumnName:
    if name in _CANONICAL:
        return ColumnName(name, *_CANONICAL[name])
    plain = _AXIS_END.sub("", _PREFIX_AXIS.sub("", name)) if axis else name
    text, unit, stranger = _without_unit(plain)
    if not unit and not stranger and below:
        unit, stranger = unit_of(below, _quantity(_words(text), "")), below
    if _NUMBERED.fullmatch(text.strip()):
        return ColumnName(name, Quantity.UNNAMED, unit, axis)
    words = _words(text)
    rank = -len(words & _KINDS["better"])
    stranger = "" if unit else stranger
    return ColumnName(name, _quantity(words, unit), unit, axis, rank, stranger)


def _words(text: str) -> frozenset[str]:
    """Words of a name, foreign ones in English, and the known ones of which compounds are made."""
    found = []
    for own in (each for each in _FOREIGN if not each.isascii()):  # written without blanks
        text = text.replace(own, f" {_FOREIGN[own]} ")
    for each in _WORD.findall(_unaccented(text).replace("i_q", "iq").replace("_", " ")):
        word = each.lower() if each.lower() in _VOCABULARY else each.lower().rstrip(digits)
        found += [_FOREIGN.get(part, part) for part in _parts(word)]
    return frozenset(found)


def _parts(word: str) -> tuple[str, ...]:
    """A word, with the known words that a compound such as `motorwinkel` is made of."""
    if word in _FOREIGN:
        return (word,)
    inside = [each for each in _VOCABULARY if word.startswith(each) or word.endswith(each)]
    return (word, *(each for each in inside if len(each) >= _LEAST_PART))


def _without_unit(name: str) -> tuple[str, str, str]:
    """Name without its unit, the unit, and what stands in its place that is none that is known."""
    name, stranger = _NUMBER.sub("", name), ""
    for match in _BRACKET.finditer(name):
        text = f"{name[: match.start()]} {name[match.end() :]}"
        if unit := unit_of(match[1], _quantity(_words(text), "")):
            return text.strip(), unit, ""
        if not {word.rstrip(digits) for word in _words(match[1])} <= _REMARKS:
            stranger = match[1]
    for match in filter(None, (_BEHIND.search(name), _SUFFIX.search(name))):
        text = name[: match.start()]
        quantity = _quantity(_words(text), "")
        unit = unit_of(match[1], quantity)
        vague = quantity is Quantity.OTHER and unit in _ALSO_WORDS
        if unit and not vague and suits(unit, quantity):
            return text, unit, ""
    return _BRACKET.sub("", name), "", stranger


def _quantity(words: frozenset[str], unit: str) -> Quantity:
    si_unit = SI.get(unit, (0.0, ""))[1]
    if words & _KINDS["none"] and not words & _POSITION - {"load"}:
        return Quantity.OTHER
    if si_unit == "s" and words & _KINDS["time"] and not words & _KINDS["counter"]:
        return Quantity.TIME
    for quantity, spelled in _SIMPLE:
        if words & spelled and not words & _POSITION:
            return quantity
    kind = Quantity.TORQUE if si_unit == "N m" else Quantity.OTHER
    if words & _KINDS["error"] and not words & _SPEED:
        kind = Quantity.POSITION_ERROR
    elif words & _SPEED:
        kind = _speed(words, unit)
    elif words & _POSITION or words & _COMMAND or si_unit in ("m", "rad"):
        kind = _position(words, unit)
    return kind


def _speed(words: frozenset[str], unit: str) -> Quantity:
    if words & _COMMAND:
        return Quantity.COMMANDED_SPEED
    turns = unit in ("rad/s", "rev/min", "rev/s", "deg/s") or words & {"rpm", "omega", "drehzahl"}
    return Quantity.MOTOR_SPEED if turns or words & _MOTOR else Quantity.SPEED


def _position(words: frozenset[str], unit: str) -> Quantity:
    if words & _COMMAND:
        return Quantity.SETPOINT
    if words & _TABLE_SIDE:
        return Quantity.TABLE_POSITION
    if words & _MOTOR or unit in ("rad", "deg", "rev"):
        return Quantity.MOTOR_POSITION
    return Quantity.POSITION
