"""Outcomes of a batch as one Parquet table: a row a case, a column for each plain value."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ...atomic import replaced_bytes
from .work import Outcome

Plain = str | float | bool | None


def row_of(command: str, outcome: Outcome) -> dict[str, Plain]:
    """Row of one case: what was done with it, its answer's plain values, and the whole answer."""
    row: dict[str, Plain] = {
        "case": outcome.case.name,
        "command": command,
        "traces": json.dumps([str(path) for path in outcome.case.traces]),
        "status": float(outcome.status),
        "error": outcome.error or None,
    }
    row |= {f"answer_{name}": value for name, value in _plain(outcome.document)}
    return row | {"document": json.dumps(outcome.document) if outcome.document else None}


def _plain(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Plain]]:
    """Numbers, texts and flags of a document by the path that leads to them; no lists."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _plain(value, f"{prefix}{name}_")
        elif isinstance(value, bool | str):
            yield prefix + name, value
        elif isinstance(value, int | float):
            yield prefix + name, float(value)


def write_table(path: Path, rows: Iterable[Mapping[str, Plain]]) -> None:
    """Write rows in the order of their cases' names; what a row lacks is null.

    A column of values of different kinds is one of texts.
    """
    import pyarrow as pa
    import pyarrow.parquet

    ordered = sorted(rows, key=lambda row: str(row["case"]))
    names = sorted({name for row in ordered for name in row if name.startswith("answer_")})
    columns = ["case", "command", "traces", "status", "error", *names, "document"]
    table = pa.table({name: _column([row.get(name) for row in ordered]) for name in columns})
    with replaced_bytes(path) as file:
        pyarrow.parquet.write_table(table, file)


def _column(values: list[Plain]) -> Any:
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if kinds == {float}:
        return pa.array(values, pa.float64())
    if kinds == {bool}:
        return pa.array(values, pa.bool_())
    texts = [None if value is None else str(value) for value in values]
    return pa.array(texts, pa.string())
