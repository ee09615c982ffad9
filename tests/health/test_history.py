"""The history against plain calculations: any resolution, crashes, damage, budget."""

import tracemalloc
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from edge_service.health.history import archive as archive_module
from edge_service.health.history import file_tier, open_records, tier
from edge_service.health.history.archive import AxisArchive
from edge_service.health.history.budget import make_room
from edge_service.health.history.record import RECORD_BYTES
from edge_service.messages.estimate import EstimateStatus, Interval, PreloadEstimate

NS = 1_000_000_000
HOUR = 3600
UNESTIMATED = PreloadEstimate(time_s=0.0, status=EstimateStatus.UNESTIMATED)
MIDNIGHT_S = datetime(2026, 1, 31, tzinfo=UTC).timestamp()


def _estimate(percent: float) -> PreloadEstimate:
    return PreloadEstimate(
        time_s=0.0,
        status=EstimateStatus.ESTIMATED,
        preload_percent=percent,
        low=percent - 1.0,
        high=percent + 2.0,
        drag_torque_nm=Interval(value=percent / 50.0, low=0.0, high=1.0),
        nis=1.5,
    )


def _fill(archive: AxisArchive, times_s: np.ndarray, values: np.ndarray) -> None:
    for time_s, value in zip(times_s.tolist(), values.tolist(), strict=True):
        archive.append(round(time_s * NS), _estimate(value), 21.5)
        if time_s % HOUR == 0:
            archive.flush()
    archive.flush()


@pytest.fixture(params=["memory", "disk"])
def archive(request: pytest.FixtureRequest, tmp_path: Path) -> AxisArchive:
    return AxisArchive(None if request.param == "memory" else tmp_path / "X")


def test_buckets_agree_with_a_plain_calculation(archive):
    values = np.random.default_rng(7).uniform(1.0, 9.0, 500)
    _fill(archive, np.arange(500.0), values)
    buckets = archive.buckets(100.0, 400.0, 60.0)
    assert [bucket.start_s for bucket in buckets] == [100.0, 160.0, 220.0, 280.0, 340.0]
    for bucket in buckets:
        inside = values[int(bucket.start_s) : int(bucket.start_s) + 60]
        assert bucket.samples == bucket.estimated == 60
        assert bucket.preload_percent.min == inside.min()
        assert bucket.preload_percent.max == inside.max()
        assert bucket.preload_percent.mean == pytest.approx(inside.mean())
        assert bucket.low == inside.min() - 1.0
        assert bucket.high == inside.max() + 2.0
        assert bucket.drag_torque_nm.mean == pytest.approx(inside.mean() / 50.0)
        assert bucket.temperature_c.mean == 21.5


def test_days_of_history_agree_at_every_resolution(tmp_path):
    """Two days across a year's end, one estimate in two minutes, through all files."""
    start_s = datetime(2025, 12, 31, tzinfo=UTC).timestamp()
    times_s = start_s + 120.0 * np.arange(2 * 720)
    values = np.random.default_rng(3).uniform(1.0, 9.0, times_s.size)
    archive = AxisArchive(tmp_path / "X")
    _fill(archive, times_s, values)
    for step_s in (120.0, 600.0, 3600.0, 43200.0):
        buckets = archive.buckets(start_s, start_s + 2 * 86400.0, step_s)
        per_bucket = int(step_s / 120.0)
        expected = values.reshape(-1, per_bucket)
        assert [each.samples for each in buckets] == [per_bucket] * len(expected)
        np.testing.assert_allclose(
            [each.preload_percent.mean for each in buckets], expected.mean(axis=1)
        )
        assert [each.preload_percent.min for each in buckets] == expected.min(axis=1).tolist()
    names = {path.name for path in tmp_path.rglob("*.parquet")}
    assert {"2025.parquet", "2026.parquet", "2025-12-31.parquet"} <= names


def test_empty_buckets_are_absent_and_silence_is_no_number(archive):
    archive.append(10 * NS, _estimate(5.0))
    archive.append(70 * NS, UNESTIMATED)
    first, last = archive.buckets(0.0, 100.0, 10.0)
    assert (first.start_s, first.preload_percent.mean) == (10.0, 5.0)
    assert (last.start_s, last.preload_percent, last.low, last.high) == (70.0, None, None, None)
    assert (last.samples, last.estimated) == (1, 0)
    assert last.status is EstimateStatus.UNESTIMATED


def test_numbers_without_the_status_are_not_kept(archive):
    archive.append(10 * NS, _estimate(5.0).model_copy(update={"status": EstimateStatus.INVALID}))
    (bucket,) = archive.buckets(0.0, 100.0, 100.0)
    assert bucket.preload_percent is None
    assert bucket.drag_torque_nm is None


def test_clock_set_back_mixes_nothing_up(archive):
    for second in (2 * HOUR + 50, 2 * HOUR + 51, 20, 21, 2 * HOUR + 52):
        archive.append(second * NS, _estimate(float(second % HOUR)))
        archive.flush()
    buckets = archive.buckets(0.0, 3.0 * HOUR, 1.0)
    assert [bucket.preload_percent.mean for bucket in buckets] == [20.0, 21.0, 50.0, 51.0, 52.0]


def test_nothing_heard_is_an_empty_history(archive):
    assert archive.buckets(0.0, 1e9, 3600.0) == ()


def test_memory_alone_is_bounded(monkeypatch):
    few = {tier.RAW: 1000, tier.MINUTE: 500, tier.HOUR: 100}
    monkeypatch.setattr(archive_module, "_MEMORY_ROWS", few)
    archive = AxisArchive()
    _fill(archive, np.arange(0.0, 3 * 86400.0, 20.0), np.full(3 * 4320, 5.0))
    tiers = (archive._raw, archive._minute, archive._hour)
    rows = [len(each.read(0.0, 1e12)) for each in tiers]
    assert rows == [1000, 500, 72]
    days = archive.buckets(0.0, 3 * 86400.0, 86400.0)
    assert [day.samples for day in days] == [4320] * 3


def test_history_goes_on_after_a_stop_and_after_a_kill(tmp_path):
    first = AxisArchive(tmp_path)
    _fill(first, MIDNIGHT_S + np.arange(100.0), np.full(100, 5.0))
    first.flush()
    killed = AxisArchive(tmp_path)  # reads what is there, and is never ended
    _fill(killed, MIDNIGHT_S + 100.0 + np.arange(50.0), np.full(50, 6.0))
    third = AxisArchive(tmp_path)
    (bucket,) = third.buckets(MIDNIGHT_S, MIDNIGHT_S + 3600.0, 3600.0)
    assert bucket.samples == 150
    assert bucket.preload_percent.mean == pytest.approx((100 * 5.0 + 50 * 6.0) / 150)


@pytest.mark.parametrize("damage", ["torn", "flipped"])
def test_a_damaged_log_loses_only_what_is_damaged(tmp_path, damage):
    archive = AxisArchive(tmp_path)
    _fill(archive, MIDNIGHT_S + np.arange(100.0), np.arange(100.0))
    path = tmp_path / "open.log"
    content = bytearray(path.read_bytes())
    if damage == "torn":
        del content[-RECORD_BYTES // 2 :]
    else:
        content[50 * RECORD_BYTES + 5] ^= 1
    path.write_bytes(content)
    opened = AxisArchive(tmp_path)
    assert len(opened.buckets(MIDNIGHT_S, MIDNIGHT_S + 100.0, 1.0)) == 99
    assert len(opened.take_damages()) == 1
    opened.append(round((MIDNIGHT_S + 200.0) * NS), _estimate(1.0))
    opened.flush()
    again = AxisArchive(tmp_path)
    assert len(again.buckets(MIDNIGHT_S, MIDNIGHT_S + 300.0, 1.0)) == 100
    assert again.take_damages() == []
    assert (tmp_path / "open.log.damaged").exists() == (damage == "flipped")


@pytest.mark.parametrize("fails_at", range(1, 7))
def test_a_crash_while_compacting_loses_and_doubles_nothing(tmp_path, monkeypatch, fails_at):
    archive = AxisArchive(tmp_path)
    times_s = MIDNIGHT_S + np.arange(0.0, HOUR + 120.0, 10.0)
    written = 0

    def write_or_die(path: Path, rows: object, *origin: str) -> None:
        nonlocal written
        written += 1
        if written == fails_at:
            raise OSError("the power failed")
        write_rows(path, rows, *origin)

    write_rows = file_tier.write_rows
    monkeypatch.setattr(file_tier, "write_rows", write_or_die)
    for time_s in times_s:
        archive.append(round(time_s * NS), _estimate(5.0))
    with pytest.raises(OSError, match="power"):
        archive.flush()
    monkeypatch.undo()
    opened = AxisArchive(tmp_path)
    opened.flush()
    for step_s in (10.0, 60.0, 3600.0):
        buckets = opened.buckets(MIDNIGHT_S, MIDNIGHT_S + 2 * HOUR, step_s)
        assert sum(bucket.samples for bucket in buckets) == times_s.size


def test_the_oldest_estimates_make_room_and_minutes_stay(tmp_path):
    archive = AxisArchive(tmp_path / "axis=X")
    times_s = MIDNIGHT_S + np.arange(0.0, 6.0 * HOUR + 20.0, 10.0)
    _fill(archive, times_s, np.random.default_rng(1).uniform(1.0, 9.0, times_s.size))
    raw = sorted((tmp_path / "axis=X" / "raw").iterdir())
    used = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    budget = used - raw[0].stat().st_size - raw[1].stat().st_size
    assert make_room(tmp_path, budget) == 2
    assert sorted((tmp_path / "axis=X" / "raw").iterdir()) == raw[2:]
    opened = AxisArchive(tmp_path / "axis=X")
    fine = opened.buckets(MIDNIGHT_S, MIDNIGHT_S + 6 * HOUR, 10.0)
    assert sum(bucket.samples for bucket in fine) == 6 * 360
    assert len(fine) == 2 * 60 + 4 * 360


def test_appending_never_waits_for_the_disk(tmp_path, monkeypatch):
    archive = AxisArchive(tmp_path)
    monkeypatch.setattr(open_records, "MOST_RECORDS", 10)
    with archive._lock:  # as while a compaction runs
        for second in range(5):
            archive.append(second * NS, _estimate(5.0))
    assert sum(bucket.samples for bucket in archive.buckets(0.0, 10.0, 10.0)) == 5


def test_a_log_that_cannot_be_written_loses_nothing_that_was_heard(tmp_path):
    (tmp_path / "no_folder").write_text("")
    archive = AxisArchive(tmp_path / "no_folder" / "X")
    archive.append(5 * NS, _estimate(5.0))
    with pytest.raises(OSError, match="directory"):
        archive.flush()
    (tmp_path / "no_folder").unlink()
    archive.append(6 * NS, _estimate(6.0))
    archive.flush()
    (bucket,) = archive.buckets(0.0, 10.0, 10.0)
    assert bucket.samples == 2


def test_what_a_wrong_clock_has_dated_after_now_is_named_and_makes_room_first(
    tmp_path, monkeypatch
):
    archive = AxisArchive(tmp_path / "axis=X")
    right_s = MIDNIGHT_S + np.arange(0.0, 2.0 * HOUR, 10.0)
    wrong_s = right_s[-1] + 74 * 365.25 * 86_400.0 + np.arange(0.0, 2.0 * HOUR, 10.0)
    later_s = right_s[-1] + np.arange(10.0, 2.0 * HOUR + 20.0, 10.0)
    times_s = np.concatenate([right_s, wrong_s, later_s])
    _fill(archive, times_s, np.full(times_s.size, 5.0))
    now_s = float(later_s[-1])
    named = archive.future_files(now_s)
    assert len(named) == len(set(named)) >= 4  # hours, their day, their year
    assert not [name for name in named if name < "2090"]
    buckets = archive.buckets(MIDNIGHT_S, now_s + 1.0, 3600.0)
    assert sum(bucket.samples for bucket in buckets) == right_s.size + later_s.size
    monkeypatch.setattr("edge_service.health.history.budget.now_ns", lambda: round(now_s * NS))
    before = {path.name for path in tmp_path.rglob("*.parquet")}
    used = sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file())
    assert make_room(tmp_path, used - 1) == 1
    assert before - {path.name for path in tmp_path.rglob("*.parquet")} <= set(named)
    make_room(tmp_path, 0)
    left = {path.name for path in tmp_path.rglob("*.parquet")}
    assert left == {name for name in before - set(named) if len(name) == len("2026.parquet")}
    assert archive.future_files(now_s) == []


def test_a_clock_before_this_program_takes_nothing_for_the_future(tmp_path):
    archive = AxisArchive(tmp_path / "axis=X")
    _fill(archive, MIDNIGHT_S + np.arange(0.0, HOUR + 20.0, 10.0), np.full(362, 5.0))
    assert archive.future_files(0.0) == []
    assert archive.future_files(1_600_000_000.0) == []


def test_an_hour_takes_no_more_memory_than_its_first_minute(tmp_path):
    """What was asked for is not kept, and what is heard goes where room was taken at once."""
    archive = AxisArchive(tmp_path)
    tracemalloc.start()
    try:
        taken = []
        for minute in range(30):
            times_s = MIDNIGHT_S + 60.0 * minute + np.arange(0.0, 60.0)
            _fill(archive, times_s, np.full(times_s.size, 5.0))
            assert archive.buckets(MIDNIGHT_S, MIDNIGHT_S + HOUR, 1.0)
            taken.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert taken[-1] - taken[0] < 50_000
