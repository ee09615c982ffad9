"""Understanding of a recording: the stages in their order."""

from collections.abc import Mapping, Sequence

from ..messages.channels import EXTERNAL_FORCE, TEMPERATURE
from ..messages.samples import Floats
from ..messages.units import SI
from .clock import find_clock
from .effort import find_effort
from .guess import Choice, Known, Understanding
from .names import ColumnName, Quantity
from .positions import Motion
from .unnamed import with_quantities

_PLAIN = ((Quantity.TEMPERATURE, TEMPERATURE, "degC"), (Quantity.FORCE, EXTERNAL_FORCE, "N"))


def understand(
    names: Sequence[ColumnName], values: Mapping[str, Floats], known: Known
) -> Understanding:
    """Find what the columns of one axis are.

    Args:
        names: columns of the axis, and those of no axis.
        values: column -> values as they stand in the file, shape (n,) each.
        known: what the owner says; it comes first.
    """
    found = Understanding(lead_m=known.lead_m)
    columns, table = list(with_quantities(names, values)), dict(values)
    _tell_unnamed(names, columns, found)
    time_s = find_clock(columns, table, known, found)
    if time_s is None:
        return found
    motion = Motion(columns, table, time_s, known, found)
    motion.find()
    find_effort(columns, table, motion.speed(), known, found)
    _plain_channels(columns, found)
    return found


def _tell_unnamed(
    names: Sequence[ColumnName], columns: Sequence[ColumnName], found: Understanding
) -> None:
    for before, after in zip(names, columns, strict=True):
        if before.quantity is not after.quantity:
            words = f"{after.name!r} moves like a {after.quantity.value}"
            found.say("columns", words, assumed=True)


def _plain_channels(columns: Sequence[ColumnName], found: Understanding) -> None:
    for quantity, channel, unit in _PLAIN:
        for each in columns:
            if each.quantity is quantity and channel not in found.columns:
                known_unit = each.unit if SI.get(each.unit, (0.0, ""))[1] == unit else ""
                if known_unit or quantity is Quantity.TEMPERATURE:
                    found.columns[channel] = Choice(each.name, SI[known_unit or unit][0])
                    found.say(channel, f"{each.name!r} in {known_unit or unit}")
