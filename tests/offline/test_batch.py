"""Many recordings: the same answers wherever they are worked on, and none lost with a worker."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import dask
import duckdb
import pyarrow.parquet
import pytest

from edge_service.command_answer import LISTENER, Answer
from edge_service.config import DEFAULT_MACHINE, ConfigError, EstimatorConfig, load_machine
from edge_service.offline import batch
from edge_service.offline.estimate import estimate_case
from edge_service.offline.simulate import SimulationSettings, simulate

ESTIMATE = partial(estimate_case, DEFAULT_MACHINE, config=EstimatorConfig())


def estimated(recordings: list[Path], out: Path, **named: Any) -> Answer:
    return batch.run_batch("estimate", ESTIMATE, ["estimates.csv"], recordings, out, **named)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Five recordings of an axis, and a file that is none."""
    folder = tmp_path_factory.mktemp("recordings")
    paths = [folder / f"day_{day}.csv" for day in range(5)]
    for day, path in enumerate(paths):
        simulate(load_machine(DEFAULT_MACHINE), SimulationSettings(duration_s=3.0, seed=day), path)
    nothing = folder / "notes.txt"
    nothing.write_text("bearing changed")
    return [*paths, nothing]


def written(folder: Path) -> dict[str, bytes]:
    """Everything below a folder, but the table, whose bytes hold no more than its rows."""
    files = {path for path in folder.rglob("*") if path.is_file() and path.suffix != ".parquet"}
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def rows(folder: Path) -> list[dict[str, object]]:
    told: list[dict[str, object]] = pyarrow.parquet.read_table(folder / "table.parquet").to_pylist()
    return told


def test_what_is_wrong_with_one_case_stops_no_other(recordings: list[Path], tmp_path: Path) -> None:
    said: list[str] = []
    LISTENER.set(said.append)
    answer = estimated(recordings, tmp_path)
    assert (answer.status, json.loads(answer.as_json())["answered"]) == (2, 5)
    assert "notes" in answer.words
    assert said[-1].startswith("6 of 6")
    found = {str(row["case"]): row for row in rows(tmp_path)}
    assert set(found) == {*(f"day_{day}" for day in range(5)), "notes"}
    assert found["notes"]["status"] == 2.0
    assert "notes.txt" in str(found["notes"]["error"])
    assert found["day_0"]["error"] is None


def test_the_table_is_one_that_another_program_asks(recordings: list[Path], tmp_path: Path) -> None:
    estimated(recordings, tmp_path)
    asked = f"select count(*) from '{tmp_path}/table.parquet' where answer_last_status is not null"
    assert duckdb.sql(asked).fetchall() == [(5,)]
    by_json = f"select document->>'$.blocks' from '{tmp_path}/table.parquet' where status = 0"
    assert {int(count) for (count,) in duckdb.sql(by_json).fetchall()} == {29}


def test_an_answer_of_an_earlier_run_does_not_pass_for_that_of_today(
    recordings: list[Path], tmp_path: Path
) -> None:
    path = tmp_path / "day.csv"
    path.write_bytes(recordings[0].read_bytes())
    estimated([path], tmp_path / "out")
    kept = tmp_path / "out" / "day"
    (kept / "my notes.txt").write_text("looked at")
    path.write_text("nothing that can be read")
    estimated([path], tmp_path / "out")
    assert [each.name for each in kept.iterdir()] == ["my notes.txt"]


@pytest.mark.slow
def test_processes_answer_as_one_does_although_one_dies(
    recordings: list[Path], tmp_path: Path
) -> None:
    estimated(recordings, tmp_path / "one")
    estimated(recordings, tmp_path / "two", jobs=2)
    assert written(tmp_path / "one") == written(tmp_path / "two")
    documents = [
        [str(row["document"]).replace(str(tmp_path / place), "") for row in rows(tmp_path / place)]
        for place in ("one", "two")
    ]
    assert documents[0] == documents[1]
    work = partial(batch.done, partial(dying, recordings[0]), (), tmp_path)
    found = {e.case.name: e for e in batch.in_processes(work, batch.cases_of(recordings[:3]), 2)}
    assert found["day_0"].status == 1
    assert [found[name].status for name in ("day_1", "day_2")] == [0, 0]


def dying(deadly: Path, traces: Sequence[Path], _out: Path) -> Answer:
    if traces[0] == deadly.resolve():
        os._exit(9)
    return Answer("", {"case": traces[0].stem})


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("local", "expected tls://HOST:PORT"),
        ("tcp://127.0.0.1:8786", "or --insecure"),
        ("tls://", "no scheduler"),
    ],
)
def test_a_cluster_that_is_none_is_one_clear_line(address: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        list(batch.on_cluster(partial(batch.done, ESTIMATE, (), Path()), [], address))


def test_names_of_cases_never_meet(tmp_path: Path) -> None:
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "x.csv").write_text("time_s,torque_command_nm\n0,1\n")
    given = [tmp_path / "a" / "x.csv", tmp_path / "b" / "x.csv", tmp_path / "a", tmp_path / "b"]
    assert [case.name for case in batch.cases_of(given)] == ["x", "x_2", "a", "b"]
    (tmp_path / "x_2.csv").write_text("time_s,torque_command_nm\n0,1\n")
    names = [case.name for case in batch.cases_of([tmp_path / "x_2.csv", *given])]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("given", ["missing", "empty"])
def test_a_path_without_a_recording_is_one_clear_line(given: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match=given):
        batch.cases_of([tmp_path / given])


def test_a_mistake_of_ours_is_told_with_the_case(recordings: list[Path], tmp_path: Path) -> None:
    def broken(*_: object) -> Answer:
        raise RuntimeError("cannot be")

    answer = batch.run_batch("estimate", broken, (), recordings[:2], tmp_path)
    assert answer.status == 1
    assert {row["status"] for row in rows(tmp_path)} == {1.0}


def test_a_column_of_several_kinds_is_one_of_texts(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    base = {"command": "estimate", "traces": "[]", "status": 0.0, "error": None, "document": None}
    number, text = {"case": "b", "answer_x": 1.0}, {"case": "a", "answer_x": "y"}
    batch.write_table(path, [base | number, base | text])
    table = pyarrow.parquet.read_table(path).to_pylist()
    assert [(row["case"], row["answer_x"]) for row in table] == [("a", "y"), ("b", "1.0")]


@pytest.mark.slow
def test_a_scheduler_that_somebody_else_runs_is_asked_by_tls(
    recordings: list[Path], tmp_path: Path
) -> None:
    """Scheduler and worker are Dask's own commands, with a certificate that openssl made."""
    ends = {"cert": str(tmp_path / "dask.pem"), "key": str(tmp_path / "dask.key")}
    line = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=dask"]
    line += ["-keyout", ends["key"], "-out", ends["cert"]]
    subprocess.run(line, check=True, capture_output=True)
    tls = {"ca-file": ends["cert"], "scheduler": ends, "worker": ends, "client": ends}
    configured = {"distributed": {"comm": {"tls": tls}}}
    (tmp_path / "dask.yaml").write_text(json.dumps(configured))
    place = tmp_path / "scheduler.json"
    with (
        dask.config.set({f"distributed.comm.tls.{name}": part for name, part in tls.items()}),
        dask_command("scheduler", "--protocol", "tls", "--port", "0", place=place),
        dask_command("worker", place=place),
    ):
        address = json.loads(place.read_text())["address"]
        assert address.startswith("tls://")
        estimated(recordings, tmp_path / "there", cluster=address)
    estimated(recordings, tmp_path / "here")
    assert written(tmp_path / "there") == written(tmp_path / "here")


@contextmanager
def dask_command(role: str, *options: str, place: Path) -> Iterator[None]:
    """A scheduler that writes where it is, or a worker that reads it."""
    line = [sys.executable, "-m", f"distributed.cli.dask_{role}", "--no-dashboard"]
    line += ["--scheduler-file", str(place), "--host", "127.0.0.1", *options]
    with subprocess.Popen(
        line,
        env=os.environ | {"DASK_CONFIG": str(place.parent / "dask.yaml")},
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            assert process.stderr is not None
            wanted = "Scheduler at" if role == "scheduler" else "Registered to"
            assert any(wanted in said for said in process.stderr)
            Thread(target=process.stderr.read, daemon=True).start()
            yield
        finally:
            process.terminate()
