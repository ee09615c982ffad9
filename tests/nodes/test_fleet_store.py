"""What a fleet node keeps on disk: whole or not at all, within its budget."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from edge_service.health.fleet.backfill import Caught
from edge_service.kept_database import DatabaseFailedError
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.fleet import Cursor, HistoryQuestion, Hole, KnownMachine
from edge_service.messages.health import AxisCondition
from edge_service.messages.plant import AxisReport, LoggedReport, MachineReport
from edge_service.nodes.stores.fleet_store import FleetStore

MINUTE_NS = 60_000_000_000
WHOLE = HistoryQuestion(site="s", machine="m", axis="X", most=100_000)


def logged(number: int) -> LoggedReport:
    axis = AxisReport(
        axis="X",
        condition=AxisCondition.NORMAL,
        status=EstimateStatus.ESTIMATED,
        preload_percent=8.0,
        low=7.0,
        high=9.0,
        fresh_percent=10.0,
    )
    time_ns = number * MINUTE_NS
    report = MachineReport(site="s", machine="m", time_ns=time_ns, version="1", axes=(axis,))
    return LoggedReport(number=number, report=report)


def caught(first: int, last: int, log: str = "l", holes: tuple[Hole, ...] = ()) -> Caught:
    reports = tuple(map(logged, range(first, last + 1)))
    return Caught(Cursor(log=log, number=last), reports, holes)


MACHINE = KnownMachine(site="s", machine="m", axes=("X",), heard_ns=5)


def numbers(store: FleetStore) -> list[int]:
    return [point.number for point in store.past(WHOLE)[0]]


def test_what_is_kept_is_there_again(tmp_path: Path) -> None:
    store = FleetStore(tmp_path / "f.sqlite", 1e9)
    store.keep([(MACHINE, caught(3, 5, holes=(Hole(log="l", first=1, last=2),)))])
    store.keep([(MACHINE, caught(6, 7))])
    store.close()
    again = FleetStore(tmp_path / "f.sqlite", 1e9)
    points, holes = again.past(WHOLE)
    assert [point.number for point in points] == [3, 4, 5, 6, 7]
    assert points[0].time_ns == 3 * MINUTE_NS
    assert (points[0].low, points[0].preload_percent, points[0].high) == (7.0, 8.0, 9.0)
    assert holes == [Hole(log="l", first=1, last=2)]
    (known,) = again.known()
    assert known.cursor == Cursor(log="l", number=7)
    assert known.axes == ("X",)
    again.close()


def test_a_newer_time_and_a_removal_stay(tmp_path: Path) -> None:
    store = FleetStore(tmp_path / "f.sqlite", 1e9)
    store.know([MACHINE.model_copy(update={"heard_ns": 9, "removed_ns": 7})])
    store.know([MACHINE])
    (known,) = store.known()
    assert (known.heard_ns, known.removed_ns) == (9, 7)
    store.close()


def test_the_newest_points_come_oldest_first() -> None:
    store = FleetStore(None, 1e9)
    store.keep([(MACHINE, caught(1, 50))])
    question = WHOLE.model_copy(update={"most": 3, "since_ns": 10 * MINUTE_NS})
    assert [point.number for point in store.past(question)[0]] == [48, 49, 50]
    store.close()


def test_of_two_logs_both_are_kept() -> None:
    store = FleetStore(None, 1e9)
    store.keep([(MACHINE, caught(1, 2, "old"))])
    store.keep([(MACHINE, caught(1, 3, "new"))])
    points, _ = store.past(WHOLE)
    assert sorted((point.log, point.number) for point in points) == [
        ("new", 1),
        ("new", 2),
        ("new", 3),
        ("old", 1),
        ("old", 2),
    ]
    store.close()


def test_the_oldest_go_when_the_budget_is_used_up(tmp_path: Path) -> None:
    store = FleetStore(tmp_path / "f.sqlite", 400_000)
    for k in range(40):
        store.keep([(MACHINE, caught(1 + 200 * k, 200 + 200 * k))])
    store.prune()
    assert store.size_bytes() <= 400_000
    left = numbers(store)
    assert left[-1] == 8000
    assert left == list(range(left[0], 8001))
    assert store.dropped == 8000 - len(left)
    store.close()


def test_a_damaged_file_is_set_aside_and_said(tmp_path: Path) -> None:
    path = tmp_path / "f.sqlite"
    store = FleetStore(path, 1e9)
    store.keep([(MACHINE, caught(1, 500))])
    store.close()
    content = bytearray(path.read_bytes())
    content[4096:12288] = bytes(range(256)) * 32
    path.write_bytes(bytes(content))
    again = FleetStore(path, 1e9)
    again.known()
    assert len(again.damages()) == 1
    again.keep([(MACHINE, caught(1, 500))])  # what was not saved is fetched again
    assert numbers(again) == list(range(1, 501))
    again.close()


def test_a_folder_that_cannot_be_is_an_error_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    store = FleetStore(tmp_path / "file" / "f.sqlite", 1e9)
    with pytest.raises(DatabaseFailedError):
        store.known()


WRITER = """
import sys
from pathlib import Path
from tests.nodes.test_fleet_store import MACHINE, caught, FleetStore
store = FleetStore(Path(sys.argv[1]), 1e9)
sys.stdout.write("begun\\n")
sys.stdout.flush()
for k in range(100_000):
    store.keep([(MACHINE, caught(1 + 5 * k, 5 + 5 * k))])
"""


@pytest.mark.slow
def test_cursor_and_reports_are_kept_together_when_the_process_is_killed(tmp_path: Path) -> None:
    path = tmp_path / "f.sqlite"
    for _ in range(5):
        path.unlink(missing_ok=True)
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            process.stdout.readline()
            while not path.exists() or path.stat().st_size < 50_000:
                pass
            process.send_signal(signal.SIGKILL)
        store = FleetStore(path, 1e9)
        (known,) = store.known()
        assert known.cursor is not None
        assert numbers(store) == list(range(1, known.cursor.number + 1))
        store.close()
        for each in tmp_path.iterdir():
            each.unlink()
