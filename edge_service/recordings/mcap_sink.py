"""Rows of a trace as an MCAP file: one channel, one JSON message per row."""

import json
from collections.abc import Sequence
from typing import Any, BinaryIO

from ..messages.channels import CHANNELS, TIME
from .columns import TraceError

TOPIC = "axis/samples"
SCHEMA_NAME = "edge_service.Sample"
_NS_PER_S = 1_000_000_000
_SEQUENCE_NUMBERS = 1 << 32


class McapSink:
    """Writes Arrow tables to an open file. A missing value is null.

    MCAP counts log times in ns from 0: `time_s` is the log time, or its distance from the first
    row where that is negative (metadata record `trace`, key `log_time_zero_s`).
    """

    def __init__(self, file: BinaryIO, names: Sequence[str]) -> None:
        try:
            from mcap.writer import Writer
        except ImportError:
            raise TraceError(
                "MCAP needs a package that is not here: pip install 'edge-service[mcap]'"
            ) from None
        self._writer: Any = Writer(file)
        self._writer.start(library="edge-service")
        schema_id = self._writer.register_schema(
            SCHEMA_NAME, "jsonschema", json.dumps(_schema(names)).encode()
        )
        self._channel_id = self._writer.register_channel(TOPIC, "json", schema_id)
        self._zero_s: float | None = None
        self._rows = 0

    def write_table(self, table: Any) -> None:
        """Add the rows of an Arrow table. Raises TraceError for a time that MCAP cannot hold."""
        for row in table.to_pylist():
            log_time_ns = self._log_time_ns(row[TIME])
            self._writer.add_message(
                self._channel_id,
                log_time_ns,
                json.dumps(row).encode(),
                publish_time=log_time_ns,
                sequence=self._rows % _SEQUENCE_NUMBERS,
            )
            self._rows += 1

    def close(self) -> None:
        """Write the index; the file stays open."""
        zero_s = self._zero_s or 0.0
        self._writer.add_metadata("trace", {"log_time_zero_s": repr(zero_s)})
        self._writer.finish()

    def _log_time_ns(self, time_s: float | None) -> int:
        if time_s is None:
            raise TraceError(f"row {self._rows + 1} has no time; MCAP orders its messages by time")
        if self._zero_s is None:
            self._zero_s = min(time_s, 0.0)
        log_time_ns = round((time_s - self._zero_s) * _NS_PER_S)
        if not 0 <= log_time_ns < 1 << 64:
            raise TraceError(
                f"row {self._rows + 1}: {time_s:g} s cannot be a log time of MCAP, which counts "
                "ns from 0"
            )
        return log_time_ns


def _schema(names: Sequence[str]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": {name: _property(name) for name in names},
        "required": [TIME],
    }


def _property(name: str) -> dict[str, Any]:
    if name == TIME:
        return {"type": "number", "description": "the axis' own clock, s"}
    known = CHANNELS.get(name)
    text = f"{known.description}, {known.unit}" if known else "as recorded, in its own unit"
    return {"type": ["number", "null"], "description": text}
