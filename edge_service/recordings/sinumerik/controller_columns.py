"""Meaning of a controller's names: a SINUMERIK trace, Industrial Edge columns, or nothing."""

from collections.abc import Mapping
from pathlib import Path

from ..block import Source
from ..columns import ColumnLike
from .controller_axis import ControllerAxis
from .controller_signals import (
    SINUMERIK_SIGNALS,
    ControllerColumns,
    edge_meanings,
    edge_signals,
    map_signals,
)
from .edge_source import EdgeSource
from .source import SinumerikSource


def controller_columns(
    path: Path, source: Source, axis: ControllerAxis, columns: Mapping[str, ColumnLike]
) -> ControllerColumns:
    """Columns that are known by their names.

    Args:
        path: the file, for messages.
        source: the open file.
        axis: the axis that is wanted.
        columns: of the machine file.

    Raises:
        TraceError: the axis is not there, or it is open which one is meant.
    """
    if isinstance(source, SinumerikSource):
        return map_signals(path, source.signals, SINUMERIK_SIGNALS, axis, columns)
    signals = edge_signals(source.names)
    if not signals:
        return ControllerColumns()
    names = source.context.axis_names if isinstance(source, EdgeSource) else {}
    return map_signals(path, signals, edge_meanings(signals), axis, columns, names)
