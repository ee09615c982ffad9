"""Rows of one resolution in sealed Parquet files; a damaged one is set aside."""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ...atomic import DamagedError, set_aside
from .parquet import ADOPTED, check_rows, read_rows, write_rows
from .rows import Rows, aggregate, in_order, joined, no_rows
from .tier import Resolution, outside

_CACHED_ROWS = 9_000
"""A year of hours, six days of minutes; an hour of single estimates is read anew each time."""
_UNITS_AT_ONCE = 10
"""Files of finer rows that are read in one turn to make rows anew."""
_SUFFIX = ".parquet"
Span = tuple[float, float]


class FileTier:
    """Rows in files, each whole; those read last are kept decoded.

    Args:
        folder: of the axis.
        tell: takes a sentence on each damaged file.
    """

    def __init__(self, resolution: Resolution, folder: Path, tell: Callable[[str], None]) -> None:
        self.resolution = resolution
        self.lost: list[Span] = []
        """Spans of time, s, whose file was damaged since this was last emptied."""
        self.adopted = 0
        """Files without a seal that got one."""
        self._folder = folder / resolution.name
        self._tell = tell
        self._cache: OrderedDict[Path, Rows] = OrderedDict()
        self._in_place: set[Path] = set()
        """Damaged files that could not be set aside yet."""

    def read(self, start_s: float, end_s: float) -> Rows:
        """Rows that begin in [start_s, end_s), by time, of all sound files. Raises OSError."""
        parts = [self._read(path) for path in self._paths(start_s, end_s)]
        return joined(parts).between(start_s, end_s)

    def replace(self, start_s: float, end_s: float, rows: Rows) -> None:
        """Let `rows` take the place of what is in [start_s, end_s), file by file. OSError."""
        for path in self._paths(start_s, end_s):
            mine = np.array([self._path(time_s) == path for time_s in rows.time_s], bool)
            old = self._read(path)
            new = in_order(joined([outside(old, start_s, end_s), rows.take(mine)]))
            if len(new):
                self._write(path, new)

    def files(self) -> list[Path]:
        """All its files, the oldest first."""
        return sorted(path for path in self._folder.glob(f"*{_SUFFIX}") if self._is_named(path))

    def check(self, path: Path) -> None:
        """Check a file, and seal one of a version that did not. Raises OSError."""
        try:
            if not check_rows(path):
                self._adopt(path)
        except DamagedError as error:
            self._on_damage(path, error)

    def mend(self, finer: "FileTier") -> None:
        """Make a few of the rows anew that a damaged file held, out of finer ones. OSError."""
        unit_s = finer.resolution.file_span.total_seconds()
        for _ in range(_UNITS_AT_ONCE):
            if not self.lost:
                return
            start_s, end_s = self.lost[-1]
            self._make_anew(finer, start_s, min(start_s + unit_s, end_s))
            self.lost.pop()
            if start_s + unit_s < end_s:
                self.lost.append((start_s + unit_s, end_s))

    def _make_anew(self, finer: "FileTier", start_s: float, end_s: float) -> None:
        present = self.read(start_s, end_s)
        made = aggregate(finer.read(start_s, end_s), start_s, self.resolution.step_s)
        missing = made.take(~np.isin(made.time_s, present.time_s))
        if len(missing):
            self.replace(start_s, end_s, joined([present, missing]))

    def _adopt(self, path: Path) -> None:
        rows, has_seal = read_rows(path)
        if not has_seal:
            write_rows(path, rows, ADOPTED)
            self.adopted += 1

    def _write(self, path: Path, rows: Rows) -> None:
        if path in self._in_place:
            set_aside(path)
            self._in_place.remove(path)
        if not self._folder.is_dir() and self._folder.exists():
            set_aside(self._folder)
        self._cache.pop(path, None)
        write_rows(path, rows)

    def _on_damage(self, path: Path, error: DamagedError) -> None:
        """Set a damaged file aside and say so, once."""
        if path in self._in_place:
            return
        self._cache.pop(path, None)
        self._tell(f"{path}: {error}")
        self.lost.append(self._span(path))
        self._in_place.add(path)
        with suppress(OSError):  # tried again before the place is needed
            set_aside(path)
            self._in_place.remove(path)

    def _is_named(self, path: Path) -> bool:
        try:
            return self._span(path) is not None
        except ValueError:
            return False

    def _span(self, path: Path) -> Span:
        start_s = self.resolution.start_s(path.name.removesuffix(_SUFFIX))
        return start_s, start_s + self.resolution.file_span.total_seconds()

    def _paths(self, start_s: float, end_s: float) -> Iterator[Path]:
        """Files that may hold rows of [start_s, end_s), in order."""
        if self._many(start_s, end_s):
            first, last = self._path(start_s).name, self._path(end_s).name
            yield from (path for path in self.files() if first <= path.name <= last)
            return
        seen = None
        step_s = self.resolution.file_span.total_seconds()
        for time_s in (*np.arange(start_s, end_s, step_s), np.nextafter(end_s, 0.0)):
            path = self._path(float(time_s))
            if path != seen:
                yield path
            seen = path

    def _many(self, start_s: float, end_s: float) -> bool:
        """Tell whether listing the folder is cheaper than asking for every name."""
        return end_s - start_s > 50 * self.resolution.file_span.total_seconds()

    def _path(self, time_s: float) -> Path:
        moment = datetime.fromtimestamp(time_s, UTC)
        return self._folder / f"{moment.strftime(self.resolution.file_name)}{_SUFFIX}"

    def _read(self, path: Path) -> Rows:
        rows = self._cache.pop(path, None)
        if rows is None:
            rows = self._sound_rows(path)
        if 0 < len(rows) <= _CACHED_ROWS:
            self._cache[path] = rows
        while sum(map(len, self._cache.values())) > _CACHED_ROWS:
            self._cache.popitem(last=False)
        return rows

    def _sound_rows(self, path: Path) -> Rows:
        if path in self._in_place:
            return no_rows()
        try:
            return read_rows(path)[0]
        except DamagedError as error:
            self._on_damage(path, error)
            return no_rows()
