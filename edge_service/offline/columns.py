"""From the machine file's `[columns]` to the trace room's column maps."""

from ..models.machine import Machine
from ..trace.columns import ColumnMap


def column_maps(machine: Machine) -> dict[str, ColumnMap]:
    """Column map of each mapped channel."""
    return {
        channel: ColumnMap(column.column, column.scale, column.offset)
        for channel, column in machine.columns.items()
    }
