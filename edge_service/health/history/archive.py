"""The history of one axis: new estimates in, buckets of any span out."""

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...clock import is_future
from ...messages.estimate import PreloadEstimate
from .buckets import Bucket, buckets
from .file_tier import FileTier
from .open_records import HOUR_S, OpenRecords
from .record import NAN, record_of
from .rows import Rows, aggregate, joined
from .tier import HOUR, MINUTE, RAW, MemoryTier, Resolution, Tier, filled

_MEMORY_ROWS = {RAW: 40_000, MINUTE: 10_080, HOUR: 43_800}
"""Without a folder: an hour of estimates, a week of minutes, five years of hours."""


class AxisArchive:
    """Estimates of one axis, at three resolutions.

    New estimates go to a log; when an hour is over it is compacted: the estimates themselves, one
    row per minute and one per hour, each tier in files of its own. Compacting twice, as after a
    crash between the files, gives the same files as once, and until it is done the log counts.

    `append` never waits and may be called from an event loop; everything else may be called from
    any thread and takes turns.

    Args:
        folder: Where the axis' files live; None keeps everything in memory, in bounded size.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._lock = threading.Lock()
        self._damages: list[str] = []
        log = None if folder is None else folder / "open.log"
        self._open = OpenRecords(log, self._damages.append)
        self._raw, self._minute, self._hour = (
            self._tier(each, folder) for each in (RAW, MINUTE, HOUR)
        )

    @property
    def lost(self) -> int:
        """Number of estimates that found no place."""
        return self._open.lost

    @property
    def adopted(self) -> int:
        """Number of files of an earlier version that were given a checksum."""
        return sum(tier.adopted for tier in self._file_tiers())

    def append(self, time_ns: int, estimate: PreloadEstimate, temperature_c: float = NAN) -> None:
        """Take an estimate in; it is on disk after the next `flush`."""
        self._open.append(record_of(time_ns, estimate, temperature_c))

    def flush(self, *, sync: bool = False) -> bool:
        """Write what was taken in, and compact when an hour is over; whether it was.

        Raises OSError: nothing is lost, and the next call tries again.
        """
        with self._lock:
            try:
                self._open.write(sync=sync)
                over = self._open.an_hour_is_over()
                if over:
                    self._compact()
            except OSError:
                self._open.make_room()
                raise
            return over

    def hold(self) -> None:
        """Take in what was heard while nothing may be written, in bounded size."""
        with self._lock:
            self._open.make_room()

    def rows(self, start_s: float, end_s: float, finest_step_s: float) -> Rows:
        """Rows of [start_s, end_s) whose own steps are no longer than `finest_step_s`.

        Where the finer rows have made room already, or were damaged, coarser ones stand in.
        Raises OSError.
        """
        with self._lock:
            self._open.open()
            tiers: list[Tier] = [self._raw, self._minute, self._hour]
            fine = sum(tier.resolution.step_s <= finest_step_s for tier in tiers)
            return joined(list(self._parts(start_s, end_s, tiers[fine - 1 :])))

    def buckets(self, start_s: float, end_s: float, step_s: float) -> tuple[Bucket, ...]:
        """Buckets of [start_s, end_s) that hold estimates, oldest first; empty ones are left out.

        Args:
            start_s, end_s: UNIX times, s.
            step_s: Length of a bucket, s. From a minute on, buckets are made of whole minutes, and
                from an hour on of whole hours: each belongs to the bucket in which it begins.
        """
        return buckets(aggregate(self.rows(start_s, end_s, step_s), start_s, step_s))

    def files(self) -> list[tuple[FileTier, Path]]:
        """Kept files with their tiers, the oldest of each first."""
        return [(tier, path) for tier in self._file_tiers() for path in tier.files()]

    def future_files(self, now_s: float) -> list[str]:
        """Names of kept files that are dated after now."""
        files = [(tier.resolution, path) for tier, path in self.files()]
        return [path.name for each, path in files if is_future(each.start_s(path.stem), now_s)]

    def check(self, tier: FileTier, path: Path) -> None:
        """Check one of the `files`, whoever asks for it later. Raises OSError."""
        with self._lock:
            tier.check(path)

    def mend(self) -> None:
        """Make a few of the rows anew that a damaged file held, out of finer ones. OSError."""
        with self._lock:
            for finer, tier in zip(self._file_tiers(), self._file_tiers()[1:], strict=False):
                tier.mend(finer)

    def take_damages(self) -> list[str]:
        """Sentences on the damage found since the last call."""
        found = self._damages[:]
        del self._damages[: len(found)]
        return found

    def _tier(self, resolution: Resolution, folder: Path | None) -> Tier:
        if folder is None:
            return MemoryTier(resolution, _MEMORY_ROWS[resolution])
        return FileTier(resolution, folder, self._damages.append)

    def _file_tiers(self) -> list[FileTier]:
        tiers = (self._raw, self._minute, self._hour)
        return [tier for tier in tiers if isinstance(tier, FileTier)]

    def _parts(self, start_s: float, end_s: float, tiers: list[Tier]) -> Iterator[Rows]:
        """Rows by time: those of an hour that is in the log come from there."""
        for hour_s in self._open.hours().tolist():
            if start_s < hour_s + HOUR_S and hour_s < end_s:
                if start_s < hour_s:
                    yield filled(start_s, hour_s, tiers)
                start_s = max(start_s, hour_s)
                rows, minutes = self._whole_hour(hour_s)
                best = rows if minutes is None else minutes
                yield best.between(start_s, min(end_s, hour_s + HOUR_S))
                start_s = hour_s + HOUR_S
        if start_s < end_s:
            yield filled(start_s, end_s, tiers)

    def _whole_hour(self, start_s: float) -> tuple[Rows, Rows | None]:
        """Single estimates of an hour in files and log, and its minutes if they know of more."""
        end_s = start_s + HOUR_S
        known, before = self._raw.read(start_s, end_s), self._minute.read(start_s, end_s)
        rows = self._open.rows(start_s, end_s)
        fresh = rows.take(~np.isin(rows.time_s, known.time_s))
        if int(before.samples.sum()) > len(known):
            return joined([known, fresh]), aggregate(joined([before, fresh]), start_s, 60.0)
        return joined([known, fresh]), None

    def _compact(self) -> None:
        for hour_s in self._open.hours().tolist():
            self._compact_hour(hour_s)
        self._open.clear()

    def _compact_hour(self, start_s: float) -> None:
        end_s = start_s + HOUR_S
        rows, minutes = self._whole_hour(start_s)
        if minutes is None:
            minutes = aggregate(rows, start_s, 60.0)
        self._raw.replace(start_s, end_s, rows)
        self._minute.replace(start_s, end_s, minutes)
        self._hour.replace(start_s, end_s, aggregate(minutes, start_s, HOUR_S))
