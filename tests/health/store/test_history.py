"""History in three resolutions: what comes in comes out, whatever is dropped or damaged."""

import io
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest

from edge_service.health.store.history import HOUR_S, History, write_history
from edge_service.health.store.store import Store, StoreFailedError
from edge_service.messages.estimate import EstimateStatus
from tests.messages.examples import estimate_of

NS = 10**9
START_S = 1_795_000_000 // HOUR_S * HOUR_S
estimate = partial(estimate_of, half_width=0.5)


@pytest.fixture(params=[True, False], ids=["file", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    with closing(Store(tmp_path / "a.sqlite" if request.param else None)) as made:
        yield made


def fill(history: History, hours: float, step_s: float = 30.0, axis: str = "X") -> np.ndarray:
    """Let estimates come, which say their number, flushed as the hours pass; their times, s."""
    times_s = START_S + np.arange(0.0, hours * HOUR_S, step_s)
    for number, time_s in enumerate(times_s.tolist()):
        history.append(axis, round(time_s * NS), estimate(float(number)), 20.0)
        if number % 50 == 0:
            history.flush(time_s)
    for _ in range(3):
        history.flush(START_S + hours * HOUR_S + 1.0)
    return times_s


def times_of(rows: np.ndarray) -> list[float]:
    return (rows["time_us"] / 1e6).tolist()


def test_the_estimates_of_a_second_are_one_row(store: Store) -> None:
    history = History(store)
    for number in range(25):
        history.append("X", START_S * NS + number * NS // 10, estimate(float(number)))
        if number == 4:
            history.flush(START_S + 0.5)
    rows = history.rows("X", START_S, START_S + 60, 0.1)
    assert times_of(rows) == [START_S, START_S + 1, START_S + 2]
    assert rows["samples"].tolist() == [10, 10, 5]
    assert rows["values"][:, :, 0].tolist() == [[0, 4.5, 9], [10, 14.5, 19], [20, 22, 24]]


def test_every_estimate_is_there_before_and_after_its_hour_is_over(store: Store) -> None:
    history = History(store)
    times_s = fill(history, 2.5)
    history.append("X", round((times_s[-1] + 1.0) * NS), estimate(None))
    rows = history.rows("X", START_S, START_S + 3 * HOUR_S, 0.1)
    assert times_of(rows) == [*times_s, times_s[-1] + 1.0]
    assert rows["values"][:-1, 1, 0].tolist() == list(range(len(times_s)))
    assert np.isnan(rows["values"][-1, 1, 0])
    again = History(store).rows("X", START_S, START_S + 3 * HOUR_S, 0.1)
    assert times_of(again) == times_s.tolist()
    assert len(history.rows("Y", START_S, START_S + 3 * HOUR_S, 0.1)) == 0


def test_buckets_of_any_step_hold_the_same_estimates(store: Store) -> None:
    history = History(store)
    count = len(fill(history, 3.0))
    for step_s in (1.0, 60.0, 600.0, 3600.0, 7200.0):
        found = history.buckets("X", START_S, START_S + 4 * HOUR_S, step_s)
        assert sum(each.samples for each in found) == count
        spreads = [each.preload_percent for each in found if each.preload_percent]
        assert min(each.min for each in spreads) == 0.0
        assert max(each.max for each in spreads) == count - 1
        assert found[0].low == -0.5
        assert found[0].status is EstimateStatus.ESTIMATED
    (hour,) = history.buckets("X", START_S + HOUR_S, START_S + 2 * HOUR_S, 3600.0)
    assert hour.preload_percent is not None
    assert hour.preload_percent.mean == pytest.approx(120.0 + 119.0 / 2.0)


def test_what_is_written_while_it_is_read_counts_once(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, read = History(store), store.read
    for number in range(10):
        history.append("X", START_S * NS + number * NS // 10, estimate(float(number)))

    def read_late(work: Any) -> Any:
        flushing = threading.Thread(target=history.flush, args=(START_S + 1.0,), daemon=True)
        flushing.start()
        flushing.join(0.05)  # a flush that is not held off is done by then
        return read(work)

    monkeypatch.setattr(store, "read", read_late)
    rows = history.rows("X", START_S, START_S + 60, 1.0)
    assert rows["samples"].tolist() == [10]


def test_late_estimates_join_their_hour(store: Store) -> None:
    history = History(store)
    count = len(fill(history, 2.0))
    history.append("X", round((START_S + 7.0) * NS), estimate(-1.0))
    history.flush(START_S + 5 * HOUR_S)
    history.flush(START_S + 5 * HOUR_S)
    for step_s in (0.1, 60.0, 3600.0):
        found = history.buckets("X", START_S, START_S + 3 * HOUR_S, step_s if step_s > 1 else 5.0)
        assert sum(each.samples for each in found) == count + 1
        assert found[0].preload_percent is not None
        assert found[0].preload_percent.min == min(0.0, -1.0 if step_s > 1 else 0.0)


def test_what_the_disk_does_not_take_waits_in_bounded_number(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("edge_service.health.store.history.MOST_WAITING", 10)

    def fail(_work: object) -> None:
        raise StoreFailedError("full")

    history = History(store)
    with monkeypatch.context() as broken:
        broken.setattr(store, "write", fail)
        for number in range(15):
            history.append("X", (START_S + number) * NS, estimate(float(number)))
        with pytest.raises(StoreFailedError):
            history.flush(START_S)
        assert history.lost == 5
        assert len(history.rows("X", START_S, START_S + 60, 0.1)) == 10
    history.flush(START_S + 20.0)
    rows = History(store).rows("X", START_S, START_S + 60, 0.1)
    assert rows["values"][:, 1, 0].tolist() == list(range(5, 15))


def test_estimates_make_room_first_and_minutes_stand_in(tmp_path: Path) -> None:
    with closing(Store(tmp_path / "a.sqlite")) as store:
        history = History(store, budget_mb=0.001)
        count = len(fill(history, 3.0, 5.0))
        steps = store.read(lambda db: db.execute("SELECT DISTINCT step_s FROM history").fetchall())
        assert steps == [(HOUR_S,)]
        found = history.buckets("X", START_S, START_S + 4 * HOUR_S, 5.0)
        assert (sum(each.samples for each in found), len(found)) == (count, 3)
        history = History(store, budget_mb=100.0)
        for number in range(100):
            history.append("X", round((START_S + 3600 * 4 + number) * NS), estimate(1.0))
        history.flush(START_S + 3600 * 5)
        rows = np.concatenate([each["samples"] for each in history.spans("X")])
        assert rows.sum() == count + 100


def test_a_damaged_chunk_is_left_out_said_once_and_stood_in_for(store: Store) -> None:
    history = History(store)
    count = len(fill(history, 2.0))
    spoil = "UPDATE history SET rows = zeroblob(50) WHERE step_s = 1 AND start_s = ?"
    store.write(lambda file: file.execute(spoil, (START_S,)))
    for _ in range(2):
        rows = history.rows("X", START_S, START_S + 2 * HOUR_S, 0.1)
        assert int(rows["samples"].sum()) == count
        assert len(rows) == 60 + count // 2
    assert len(store.damages) == 1
    moved = "UPDATE history SET axis = 'Y' WHERE step_s = 60"
    store.write(lambda file: file.execute(moved))
    assert len(history.rows("Y", START_S, START_S + 2 * HOUR_S, 60.0)) == 0


def test_a_file_has_every_row_of_every_axis(store: Store) -> None:
    history = History(store)
    times_s, other_s = fill(history, 1.5), fill(history, 1.0, 60.0, "Y")
    assert history.axes() == ["X", "Y"]
    sink = io.BytesIO()
    written = write_history(sink, "parquet", history, history.axes())
    table = pyarrow.parquet.read_table(io.BytesIO(sink.getvalue()))
    assert written == table.num_rows == len(times_s) + len(other_s)
    assert table["axis"].to_pylist() == ["X"] * len(times_s) + ["Y"] * len(other_s)
    assert table["preload_percent"].to_pylist()[: len(times_s)] == list(range(len(times_s)))
    assert [each.timestamp() for each in table["time"].to_pylist()[:3]] == times_s[:3].tolist()
    text = io.BytesIO()
    start_s = START_S + HOUR_S
    write_history(text, "csv", history, ["X"], start_s, start_s + 60.0)
    read = pyarrow.csv.read_csv(io.BytesIO(text.getvalue()))
    assert read["samples"].to_pylist() == [1, 1]
    assert read["status"].to_pylist() == ["estimated"] * 2


def test_an_hour_is_kept_once_or_in_the_open_table(tmp_path: Path) -> None:
    """A crash within the compaction leaves what was there before."""
    path = tmp_path / "a.sqlite"
    with closing(Store(path)) as store:
        history = History(store)
        for number in range(100):
            history.append("X", (START_S + number) * NS, estimate(1.0))
        history.flush(START_S + 200.0)

        def crash(file: sqlite3.Connection) -> None:
            history._compact(file, "X", START_S)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            store.write(crash)
    with closing(Store(path)) as store:
        assert len(History(store).rows("X", START_S, START_S + HOUR_S, 0.1)) == 100
