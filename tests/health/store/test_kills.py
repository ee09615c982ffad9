"""A service that is killed loses nothing that it said was kept; damage is never served."""

import json
import random
import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from edge_service.health.store.events import EventLog
from edge_service.health.store.history import HOUR_S, History
from edge_service.health.store.outbox import Outbox
from edge_service.health.store.store import (
    DamagedStateError,
    State,
    Store,
    StoreFailedError,
    load_state,
)
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition, Event

NS = 10**9
START_S = 1_795_000_000 // HOUR_S * HOUR_S
FILE = "a.sqlite"
PER_ROUND, ROUNDS_AN_HOUR = 5, 20


def event(number: int) -> Event:
    text = f"{number} {'x' * (number % 300)}"
    info = AxisCondition.NORMAL
    return Event(axis="X", kind="note", level=info, text=text, time_ns=START_S * NS + number)


def estimate(number: int) -> tuple[int, PreloadEstimate]:
    """UNIX time in ns and an estimate that says its number."""
    at_s = START_S + number * HOUR_S / PER_ROUND / ROUNDS_AN_HOUR
    estimated = EstimateStatus.ESTIMATED
    percent = float(number)
    told = PreloadEstimate(
        time_s=0.0, status=estimated, preload_percent=percent, low=percent, high=percent
    )
    return round(at_s * NS), told


def work(store: Store, first: int, rounds: int) -> None:
    """Rounds of an event with a state and of estimates; each is said once it is on the disk."""
    log, history = EventLog(store), History(store)
    for number in range(first, first + rounds):
        log.put([event(number)], START_S * NS, [State.of("monitor", "X", {"number": number})])
        log.save()
        for each in range(PER_ROUND):
            history.append("X", *estimate(PER_ROUND * number + each))
        history.flush(START_S + number * HOUR_S / ROUNDS_AN_HOUR)
        sys.stdout.write(f"{number}\n")
        sys.stdout.flush()


@pytest.mark.parametrize("times", [4, pytest.param(200, marks=pytest.mark.slow)])
def test_killed_services_lose_nothing(tmp_path: Path, times: int) -> None:
    path, rng, newest, said = tmp_path / FILE, random.Random(times), -1, set[int]()
    for _ in range(times):
        code = (
            f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
            "from pathlib import Path; from test_kills import Store, work\n"
            f"work(Store(Path({str(path)!r})), {newest + 1}, 10**6)"
        )
        command = [sys.executable, "-c", code]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                said.add(int(line))
                if rng.random() < 0.1:
                    process.send_signal(signal.SIGKILL)
                    break
            said |= set(map(int, process.stdout.read().split()))  # said before it died
        with closing(Store(path)) as store:
            notes = [each.event for each in EventLog(store).after(0, 10**6)]
            assert notes == [event(number) for number in range(len(notes))]
            assert len(notes) - max(said, default=-1) in (1, 2)
            assert load_state(store, "monitor", "X") == {"number": len(notes) - 1}
            rows = History(store).rows("X", START_S, START_S + 10**6, 0.1)
            numbers = rows["values"][:, 1, 0].astype(int).tolist()
            assert numbers == sorted(set(numbers))
            assert {PER_ROUND * each + k for each in said for k in range(PER_ROUND)} <= set(numbers)
            assert store.damages == []
        newest = len(notes) - 1


def damaged(content: bytes, rng: random.Random) -> bytes:
    """A file with a flipped bit, a lost sector, a cut end, or zeros."""
    changed = bytearray(content)
    at = rng.randrange(len(changed))
    match rng.randrange(4):
        case 0:
            changed[at] ^= 1 << rng.randrange(8)
        case 1:
            changed[at : at + 512] = rng.randbytes(len(changed[at : at + 512]))
        case 2:
            del changed[at:]
        case _:
            changed[at : at + 4096] = bytes(len(changed[at : at + 4096]))
    return bytes(changed)


def check_true(store: Store, known: int) -> None:
    """Check that only written rows are served, that the store works on, and that damage is told."""
    log = EventLog(store)
    notes = [each.event for each in log.after(0, 10**6)]
    told = [event(number) for number in range(known)]
    assert [each for each in notes if each not in told] == []
    assert len({each.text for each in notes}) == len(notes)
    rows = History(store).rows("X", START_S, START_S + 10**6, 0.1)
    single = rows[rows["samples"] == 1]
    for time_us, number in zip(single["time_us"], single["values"][:, 1, 0], strict=True):
        within_s = estimate(int(number))[0] / NS - time_us / 1e6  # of an estimate, or of its minute
        assert -1e-3 < within_s < 60.0
    assert np.all(np.diff(rows["time_us"]) > 0.0)
    try:
        state = load_state(store, "monitor", "X")
    except DamagedStateError:
        state = None
    assert state in (None, {"number": known - 1})
    complete = len(notes) == known and int(rows["samples"].sum()) == known * PER_ROUND
    assert complete or store.damages or state is None
    outbox = Outbox(store, "mqtt")
    outbox.waiting(1)
    (put,) = log.add([event(known)], START_S * NS)
    assert put.id in [each.id for each in outbox.waiting(10)]
    assert log.after(put.id - 1, 1) == [put]


@pytest.mark.parametrize("times", [60, pytest.param(3000, marks=pytest.mark.slow)])
def test_damage_is_never_served(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], times: int
) -> None:
    known, path = 70, tmp_path / FILE
    with closing(Store(path)) as store:
        work(store, 0, known)
    whole = path.read_bytes()
    for seed in range(times):
        for old in tmp_path.iterdir():
            old.unlink()
        path.write_bytes(damaged(whole, random.Random(seed)))
        with closing(Store(path)) as store:
            try:
                check_true(store, known)
            except StoreFailedError as error:  # met while it was in use: the next use mends it
                assert json.dumps(str(error))
                check_true(store, known)
    capsys.readouterr()
