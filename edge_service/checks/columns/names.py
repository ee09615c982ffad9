"""Meaning of a column's name: quantity, unit and axis, as loggers and controllers spell them.

The words are those of SINUMERIK servo data and Industrial Edge (`recordings/sinumerik`), of joint
states in ROS, and those that data loggers and laboratories write in English and German.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from ...messages.samples import (
    ANGLE,
    EXTERNAL_FORCE,
    MOTOR_SPEED,
    SETPOINT,
    SI,
    TABLE_POSITION,
    TABLE_SPEED,
    TEMPERATURE,
    TIME,
    TORQUE,
)
from ...recordings.sinumerik.signals import (
    EDGE_SIGNALS,
    SINUMERIK_SIGNALS,
    edge_signals,
    sinumerik_signal,
)


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
    """Meaning of one name.

    Attributes:
        axis: of the controller, as the name spells it; empty where it names none.
        unit: as `messages.units` writes it, or A, V, %, s; empty where the name gives none.
        rank: the smaller, the better a column of the same quantity serves.
    """

    name: str
    quantity: Quantity
    unit: str = ""
    axis: str = ""
    rank: int = 0

    @property
    def si_unit(self) -> str:
        """SI unit of what it measures; empty where the name gives no unit of that kind."""
        return SI.get(self.unit, (0.0, ""))[1]


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_COMMAND = _words(
    "set sp setpoint ref reference cmd command commanded demand demanded desired des target "
    "soll sollwert profile contr ctrl"
)
_ERROR = _words("error err dev deviation diff following lag schleppabstand regeldifferenz")
_MOTOR = _words("motor mot rotary rotor angle winkel theta enc1 1st resolver measpos1")
_TABLE = _words("table linear enc2 2nd scale slide load tisch glass direct measpos2")
_POSITION = _words(
    "pos position q x angle winkel lage weg enc enc1 enc2 encoder theta displacement travel "
    "stroke measpos1 measpos2 point"
)
_SPEED = _words("vel velocity speed velo v omega n rpm drehzahl geschwindigkeit feed qd")
_NO_QUANTITY = _words(
    "ffw feedforward forward precontrol vorsteuerung acceleration accel acc jerk power "
    "voltage inertia load number program feedrate"
)
_NO_QUANTITY |= _words("sequence status tool block count label run group limit")
_SIMPLE = (
    (Quantity.TORQUE, _words("torque trq moment drehmoment momentum tau effort")),
    (Quantity.CURRENT, _words("current curr strom iq amps amp i")),
    (Quantity.TEMPERATURE, _words("temp temperature temperatur")),
    (Quantity.FORCE, _words("force kraft fext")),
    (Quantity.COUNTER, _words("cycle counter tick ticks sample index idx")),
    (Quantity.TIME, _words("time t timestamp zeit clock stamp")),
)
_VOCABULARY = _COMMAND | _ERROR | _MOTOR | _TABLE | _POSITION | _SPEED | _NO_QUANTITY
_VOCABULARY = _VOCABULARY.union(*(words for _, words in _SIMPLE))
_LEAST_PART = 4
_BETTER = _words("feedback actual act meas measured ist cmd")
_UNITS = {
    **{unit.replace(" ", "").lower(): unit for unit in SI},
    **{"s": "s", "sec": "s", "seconds": "s", "ms": "ms", "us": "us", "µs": "us", "ns": "ns"},
    **{"a": "A", "ma": "mA", "amp": "A", "v": "V", "%": "%", "percent": "%", "kgf": "kgf"},
    **{"rpm": "rev/min", "1/min": "rev/min", "u/min": "rev/min", "min-1": "rev/min"},
    **{"rps": "rev/s", "°": "deg", "degree": "deg", "degrees": "deg", "°/s": "deg/s"},
    **{"µm": "um", "nm": "N m", "n.m": "N m", "n*m": "N m", "mnm": "mN m", "°c": "degC"},
    **{"m_s": "m/s", "mm_s": "mm/s", "mm_min": "mm/min", "rad_s": "rad/s", "deg_s": "deg/s"},
    **{"c": "degC", "degc": "degC", "celsius": "degC", "rev": "rev", "mps": "m/s"},
}
_BRACKET = re.compile(r"\s*[\[(]\s*([^\])]+?)\s*[\])]\s*$")
_SUFFIX = re.compile(r"_(mm_min|mm_s|rad_s|deg_s|m_s|[A-Za-z%°µ]+)$")
_PREFIX_AXIS = re.compile(r"^([XYZABCUVWSQ]\d?|[Aa]x(?:is)?_?\d+|[Aa]xis_?[A-Za-z]\d?)[_./ :]")
_SUFFIX_AXIS = re.compile(r"[_./ :]([XYZABCUVW]\d?|[Aa]x(?:is)?_?\d+)$")
_WORD = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-zà-ÿ]+\d?|[A-Z]+\d?|\d+(?:st|nd)|#\d+")
_NUMBERED = re.compile(r"#?\d+|col(?:umn)?_?\d+|ch(?:annel)?_?\d+|", re.IGNORECASE)

_CANONICAL = {
    TIME: (Quantity.TIME, "s"),
    TORQUE: (Quantity.TORQUE, "N m"),
    ANGLE: (Quantity.MOTOR_POSITION, "rad"),
    MOTOR_SPEED: (Quantity.MOTOR_SPEED, "rad/s"),
    TABLE_POSITION: (Quantity.TABLE_POSITION, "m"),
    TABLE_SPEED: (Quantity.SPEED, "m/s"),
    SETPOINT: (Quantity.SETPOINT, "m"),
    TEMPERATURE: (Quantity.TEMPERATURE, "degC"),
    EXTERNAL_FORCE: (Quantity.FORCE, "N"),
}
_CONTROLLER = {
    short: (Quantity.CURRENT if "curr" in short.lower() else _CANONICAL[channel][0], rank)
    for signals in (SINUMERIK_SIGNALS, EDGE_SIGNALS)
    for channel, shorts in signals.items()
    for rank, short in enumerate(shorts)
}

QUANTITIES = {
    **{channel: quantity for channel, (quantity, _) in _CANONICAL.items()},
    "current": Quantity.CURRENT,
    "position_error": Quantity.POSITION_ERROR,
    "counter": Quantity.COUNTER,
}
"""Word for a quantity on the command line -> quantity."""


def unit_of(text: str) -> str:
    """A unit as it is written here; empty for one that is not known."""
    return _UNITS.get(text.replace(" ", "").lower(), "")


def column_names(names: Sequence[str]) -> list[ColumnName]:
    """Meaning of every name of a file, in its order."""
    controller, axes = _controller_names(names), dict[str, str]()
    for name in names:
        match = _PREFIX_AXIS.search(name) or _SUFFIX_AXIS.search(_BRACKET.sub("", name))
        if match:
            axes[name] = match[1]
    often = Counter(axes.values())  # a letter that only one name has is none
    axes = {name: axis for name, axis in axes.items() if often[axis] > 1}
    return [controller.get(name) or _plain_name(name, axes.get(name, "")) for name in names]


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


def _plain_name(name: str, axis: str) -> ColumnName:
    if name in _CANONICAL:
        return ColumnName(name, *_CANONICAL[name])
    text, unit = _without_unit(name)
    if axis:
        text = _SUFFIX_AXIS.sub("", _PREFIX_AXIS.sub("", text))
    if _NUMBERED.fullmatch(text.strip()):
        return ColumnName(name, Quantity.UNNAMED, unit, axis)
    words = [part for word in _WORD.findall(text) for part in _parts(word.lower())]
    quantity = _quantity(frozenset(words), unit)
    rank = -sum(word in _BETTER for word in words)
    return ColumnName(name, quantity, unit, axis, rank)


def _parts(word: str) -> tuple[str, ...]:
    """A word, with the known words that a compound such as `motorwinkel` is made of."""
    inside = [each for each in _VOCABULARY if word.startswith(each) or word.endswith(each)]
    return (word, *(each for each in inside if len(each) >= _LEAST_PART))


def _without_unit(name: str) -> tuple[str, str]:
    for pattern in (_BRACKET, _SUFFIX):
        match = pattern.search(name)
        unit = unit_of(match[1]) if match else ""
        if match and unit:
            return name[: match.start()], unit
    return name, ""


def _quantity(words: frozenset[str], unit: str) -> Quantity:
    if words & _NO_QUANTITY and not words & _POSITION - {"load"}:
        return Quantity.OTHER
    for quantity, spelled in _SIMPLE:
        if words & spelled and not words & _POSITION:
            return quantity
    if words & _ERROR and not words & _SPEED:
        return Quantity.POSITION_ERROR
    if words & _SPEED:
        return _speed(words, unit)
    if words & _POSITION or words & _COMMAND or SI.get(unit, (0.0, ""))[1] in ("m", "rad"):
        return _position(words, unit)
    return Quantity.OTHER


def _speed(words: frozenset[str], unit: str) -> Quantity:
    if words & _COMMAND:
        return Quantity.COMMANDED_SPEED
    turns = unit in ("rad/s", "rev/min", "rev/s", "deg/s") or words & {"rpm", "omega", "drehzahl"}
    return Quantity.MOTOR_SPEED if turns or words & _MOTOR else Quantity.SPEED


def _position(words: frozenset[str], unit: str) -> Quantity:
    if words & _COMMAND:
        return Quantity.SETPOINT
    if words & _TABLE:
        return Quantity.TABLE_POSITION
    if words & _MOTOR or unit in ("rad", "deg", "rev"):
        return Quantity.MOTOR_POSITION
    return Quantity.POSITION
