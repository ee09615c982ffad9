"""The names and units of a controller's signals: SINUMERIK traces and Industrial Edge columns.

Units of a SINUMERIK trace, by `unitsType`, as recordings show them (the speed of a linear axis is
60 times the derivative of its position): posn mm, velo mm/min, current A. A rotary axis has posn in
degrees and velo in rev/min. `CmdTorque` is in N m whatever its `unitsType` (611DTime1 occurs).
Units of Industrial Edge columns (Siemens, SINUMERIK Connector, "Which HF data can be collected"):
positions mm, speeds mm/s, torque N m. A scale under [columns] in the machine file comes first.

No channel has the meaning of commanded speeds (`CMD_SPEED`, `CmdVelCtrlIn`; the speed channels are
measured), following error, load and status. `ActVelMotorSide` (veloRot) is left out as well: no
source gives its unit, and one recording shows 18 rev/min as 0.005.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from ...messages.samples import CHANNELS, SI, TABLE_POSITION, ColumnMap, factor_to
from ..columns import AxisError


@dataclass(frozen=True, slots=True)
class ControllerAxis:
    """Axis of a controller's recording that is wanted, and what turns its signals into channels."""

    number: int | None = None  # the controller's number of the axis; None takes the only one there
    # table travel per revolution of the screw, m. Controllers give the rotary encoder in mm of
    # table travel, so without it there is no motor angle.
    lead_m: float | None = None
    # draw positions of a slower clock as straight lines between their samples instead of holding
    # them
    interpolate_positions: bool = False

    def scale(self, channel: str, unit: str | None) -> float | None:
        """Factor from `unit` to the unit of `channel`; None where this axis cannot tell it."""
        wanted = CHANNELS[channel].unit
        if unit is None or unit not in SI or (self.lead_m is None and SI[unit][1] != wanted):
            return None
        return factor_to(unit, wanted, self.lead_m or 1.0)


_TABLE = tomllib.loads((files(__package__) / "signals.toml").read_text("utf-8"))
SINUMERIK_UNITS, EDGE_UNITS = (_TABLE[name]["units"] for name in ("sinumerik", "edge"))
SINUMERIK_SIGNALS, EDGE_SIGNALS = (_TABLE[name]["signals"] for name in ("sinumerik", "edge"))
"""Channel -> signals that hold it, the better one first."""
EDGE_CYCLE = "CYCLE"
EDGE_ACTIVE_ENCODER = "ENC_POS"
"""Position of the encoder that the controller uses, whichever that is."""

_LACKING = {None: "its unit", "A": "the torque constant in N m/A"}
"""Unit of a signal -> what is lacking to read it as any channel."""
_SINUMERIK_NAME = re.compile(r"(?:.*/)?(?P<short>[^/\[\s]+)\s*\[.*[,;]\s*(?P<axis>\d+)\s*\]\s*")
_SERVO_DATA = re.compile(r"nckServoData(?P<short>.+?)(?:32|64)?")
_EDGE_NAME = re.compile(r"(?P<short>[A-Z][A-Z0-9_]*)\|(?P<axis>\d+)")


@dataclass(frozen=True, slots=True)
class ControllerSignal:
    """One signal of a controller's recording."""

    column: str  # its name in the file
    short: str  # what it measures, in the controller's words
    axis: int  # the controller's number of the axis
    unit: str | None  # of its values; None where nothing is known about it


@dataclass(frozen=True, slots=True)
class ControllerColumns:
    """Mapping of the signals of one axis to channels."""

    columns: dict[str, ColumnMap] = field(default_factory=dict)  # channel -> its column
    # short name -> name of the column, for the chosen axis
    aliases: dict[str, str] = field(default_factory=dict)
    # channel -> how its column is read, in words
    used: dict[str, str] = field(default_factory=dict)
    # channel -> what would be needed to read a signal as this channel, in words
    lacking: dict[str, str] = field(default_factory=dict)

    def resolve(self, columns: Mapping[str, ColumnMap]) -> dict[str, ColumnMap]:
        """A machine file's columns with short names written out."""
        found = {}
        for channel, each in columns.items():
            names = (each.column, each.minus, each.direction)
            column, minus, direction = (self.aliases.get(name, name) for name in names)
            found[channel] = ColumnMap(column, each.scale, each.offset, minus, direction)
        return found

    def remarks(self, chosen: Mapping[str, ColumnMap]) -> tuple[str, ...]:
        """One line on each channel that is read by its name, or could be if more were known."""
        used = [line for name, line in self.used.items() if chosen[name] == self.columns[name]]
        return (*used, *(line for name, line in self.lacking.items() if name not in chosen))


def sinumerik_signal(column: str, units_type: str) -> ControllerSignal | None:
    """Signal of a name such as `/Nck/!SD/nckServoDataActCurr32 [u1, 7]`; None if of no axis.

    The last index is the axis.
    """
    found = _SINUMERIK_NAME.fullmatch(column)
    if found is None:
        return None
    servo = _SERVO_DATA.fullmatch(found["short"])
    short = servo["short"] if servo else found["short"]
    unit = "N m" if short == "CmdTorque" else SINUMERIK_UNITS.get(units_type)
    return ControllerSignal(column, short, int(found["axis"]), unit)


def edge_signals(names: Sequence[str]) -> list[ControllerSignal]:
    """Signals of columns such as `ENC1_POS|1`; none if no known one is among them."""
    signals = [
        ControllerSignal(name, match["short"], int(match["axis"]), EDGE_UNITS.get(match["short"]))
        for name in names
        if (match := _EDGE_NAME.fullmatch(name))
    ]
    return signals if any(signal.unit for signal in signals) else []


def edge_meanings(signals: Sequence[ControllerSignal]) -> dict[str, tuple[str, ...]]:
    """Meaning of Edge's names in one file.

    The active encoder is the table's only where no encoder is recorded by itself: it would be the
    same one again, and two of it would show a transmission that never stretches.
    """
    meanings: dict[str, tuple[str, ...]] = dict(EDGE_SIGNALS)
    if not {"ENC1_POS", "ENC2_POS"} & {signal.short for signal in signals}:
        meanings[TABLE_POSITION] = (EDGE_ACTIVE_ENCODER,)
    return meanings


def map_signals(
    path: Path,
    signals: Sequence[ControllerSignal],
    meanings: Mapping[str, Sequence[str]],
    axis: ControllerAxis,
    columns: Mapping[str, ColumnMap],
    axis_names: Mapping[int, str] | None = None,
) -> ControllerColumns:
    """Columns of one axis.

    Args:
        signals: what the file holds.
        meanings: channel -> short names, the better one first.
        axis: the axis that is wanted.
        columns: of the machine file; a signal that they name says which axis is meant.
        axis_names: number of an axis -> its name, for messages.

    Raises AxisError: the axis is not there, or it is open which one is meant.
    """
    if not signals and axis.number is None:
        return ControllerColumns()
    named = {column.column for column in columns.values()}
    meant = {signal.axis for signal in signals if signal.column in named}
    wanted = meant.pop() if axis.number is None and len(meant) == 1 else axis.number
    numbers = sorted({signal.axis for signal in signals})
    names = axis_names or {}
    shown = ", ".join(f"{n} ({names[n]})" if n in names else str(n) for n in numbers) or "none"
    if wanted is None and len(numbers) != 1:
        raise AxisError(
            f"{path}: axes there are: {shown}; expected the number of the one wanted "
            "(--axis-number, or number under [axis] of the machine file)"
        )
    number = numbers[0] if wanted is None else wanted
    if number not in numbers:
        raise AxisError(f"{path}: no signal of axis {number}; axes there are: {shown}")
    of_axis = {s.short.lower(): s for s in reversed(signals) if s.axis == number}
    found = ControllerColumns(aliases={each.short: each.column for each in of_axis.values()})
    for channel, shorts in meanings.items():
        for signal in (of_axis[short.lower()] for short in shorts if short.lower() in of_axis):
            scale = axis.scale(channel, signal.unit)
            if scale is None:
                lacks = _LACKING.get(signal.unit, "the lead of the screw")
                found.lacking[channel] = f"{channel} could be {signal.short}, lacking: {lacks}"
                continue
            basis = str(signal.unit)
            if SI[basis][1] != CHANNELS[channel].unit:
                basis += f", with a lead of {axis.lead_m} m"
            found.columns[channel] = ColumnMap(signal.column, scale)
            found.used[channel] = f"{channel} = {scale:.6g} * {signal.short} ({basis})"
            break
    return found
