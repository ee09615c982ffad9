"""Tables of the benchmarks, and the work behind them spread over processes."""

import math
import multiprocessing
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

from edge_service.exit_status import BadInputError

Progress = Callable[[str], None]
"""Takes a line that says how far it is."""
Result = TypeVar("Result")


class BenchError(BadInputError):
    """A measurement that could not be made; the text is one line."""


@dataclass(frozen=True, slots=True)
class Table:
    heads: tuple[str, ...]  # of the columns
    # cells of each row, as many as heads; numbers are flush right
    rows: tuple[tuple[object, ...], ...]
    notes: tuple[str, ...] = ()  # what must be known to read them
    figures: "tuple[Figure, ...]" = ()  # that the rows show, for programs

    @classmethod
    def of(cls, rows: Iterable[Mapping[str, object]], *notes: str) -> "Table":
        """Rows by the heads of their columns; a cell that a row lacks is empty."""
        every = list(rows)
        heads = tuple(dict.fromkeys(head for row in every for head in row))
        return cls(heads, tuple(tuple(row.get(head) for head in heads) for row in every), notes)

    def __str__(self) -> str:
        """Aligned columns, then the notes."""
        right = [any(isinstance(row[k], int | float) for row in self.rows) for k in self._columns]
        cells = [self.heads, *([cell(each) for each in row] for row in self.rows)]
        widths = [max(len(row[k]) for row in cells) for k in self._columns]
        lines = [
            "  ".join(
                row[k].rjust(widths[k]) if right[k] else row[k].ljust(widths[k])
                for k in self._columns
            ).rstrip()
            for row in cells
        ]
        return "\n".join([*lines, *self.notes])

    def document(self) -> dict[str, Any]:
        """The same for programs; what is no number is null."""
        if self.figures:
            told = [asdict(each) | {"met": each.met} for each in self.figures]
            return {"figures": told, "notes": self.notes}
        rows = [[_written(each) for each in row] for row in self.rows]
        return {"heads": self.heads, "rows": rows, "notes": self.notes}

    @property
    def _columns(self) -> range:
        return range(len(self.heads))


def _written(figure: object) -> object:
    if isinstance(figure, list | tuple):
        return [_written(each) for each in figure]
    return None if isinstance(figure, float) and not math.isfinite(figure) else figure


def cell(figure: object) -> str:
    """One figure as printed: three digits after the point, whole numbers as they are."""
    if figure is None:
        return "-"
    if isinstance(figure, list | tuple):
        return " ".join(cell(each) for each in figure) or "-"
    if not isinstance(figure, float):
        return str(figure)
    if math.isnan(figure):
        return "-"
    return "never" if math.isinf(figure) else f"{figure:.3f}"


@dataclass(frozen=True, slots=True)
class Figure:
    """A measured number beside a peer's and an aim."""

    name: str
    value: float
    unit: str
    theirs: float | None = None  # the same of a peer, in `unit`; less is better
    peer: str = ""  # its name
    # at_least, at_most: the aim; of the ratio if there is a peer, else of the value
    at_least: float | None = None
    at_most: float | None = None

    @property
    def ratio(self) -> float | None:
        """Cost of the peer over ours; None without a peer."""
        return None if self.theirs is None else self.theirs / self.value

    @property
    def met(self) -> bool | None:
        """Return whether the aim is met; None without one."""
        if self.at_least is None and self.at_most is None:
            return None
        value = self.value if self.ratio is None else self.ratio
        above = self.at_least is None or value >= self.at_least
        return above and (self.at_most is None or value <= self.at_most)


def figures_table(figures: Sequence[Figure], notes: Sequence[str] = ()) -> Table:
    heads = ("figure", "value", "unit", "theirs", "of", "ratio", "aim", "met")
    rows = []
    for each in figures:
        limits = ((">=", each.at_least), ("<=", each.at_most))
        aim = ", ".join(f"{sign} {limit:g}" for sign, limit in limits if limit is not None)
        numbers = (each.value, each.theirs, each.ratio)
        value, theirs, ratio = ("" if x is None else number_text(x) for x in numbers)
        met = {None: "", True: "yes", False: "NO"}[each.met]
        rows.append((each.name, value, each.unit, theirs, each.peer, ratio, aim, met))
    return Table(heads, tuple(rows), tuple(notes), tuple(figures))


def number_text(value: float) -> str:
    """Three significant digits, all digits of what is greater, thousands parted by commas."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def mean_of(values: Sequence[float]) -> float:
    """Mean of those that are finite; NaN without any."""
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else math.nan


def in_processes(
    jobs: Sequence[Callable[[], Result]], processes: int = 2
) -> Iterator[tuple[int, Result]]:
    """Number and result of each job, as they end, in processes.

    Args:
        jobs: can be pickled.
    """
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        started = {pool.submit(job): number for number, job in enumerate(jobs)}
        for done in as_completed(started):
            yield started[done], done.result()


def listed(seeds: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(set(seeds))))
