"""A command over many recordings: a folder of results a case, and one table of all."""

import json
import logging
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from importlib.metadata import version
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from uuid import uuid4

from .. import exit_status
from ..atomic import replaced_bytes
from ..command_answer import Answer
from ..config import ConfigError
from ..fingerprint.result import FingerprintError
from ..recordings.columns import TraceError
from ..recordings.forms import is_recording
from .diagnosis.sessions import BadDataError, DiagnosisError
from .document import Document
from .recordings import Progress, silent

log = logging.getLogger(__name__)
TABLE = "table.parquet"
CONNECT_S = 10.0
Work = Callable[[Sequence[Path], Path], Answer]
"""Work on the recordings of a case, which writes into a folder."""


class FailedCase(Document):
    """A case without an answer, and why."""

    case: str
    status: int
    error: str


class BatchDocument(Document):
    """Outcome of a batch."""

    command: str
    cases: int
    answered: int
    table: str
    failed: list[FailedCase]


@dataclass(frozen=True, slots=True)
class Case:
    """Recordings of one axis and one session, and the name of their folder among the results."""

    name: str
    traces: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Exit status, mistake in one line, document and files (by path) that a command left."""

    case: Case
    status: int
    error: str = ""
    document: dict[str, Any] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)


def run_batch(
    command: str,
    work: Work,
    written: Iterable[str],
    given: Sequence[Path],
    out: Path,
    jobs: int = 1,
    cluster: str | None = None,
    insecure: bool = False,
    progress: Progress = silent,
) -> Answer:
    """Write `out/CASE/` for every case and `out/table.parquet`; returns a summary.

    Args:
        work: a picklable function; what is wrong with one case stops no other.
        written: files of `work`; those of an earlier run that it leaves no more are removed.
        given: recordings, and folders with those of one session each.
        jobs: processes of this computer.
        cluster: tls://HOST:PORT of a Dask scheduler, or with `insecure` tcp://HOST:PORT.

    Raises:
        ConfigError: a path or a cluster is not there, or nothing can be written.
    """
    cases = cases_of(given)
    rows, failed = [], []
    if cluster is not None:
        found = on_cluster(work, cases, cluster, insecure=insecure)
    else:
        found = map(partial(done, work), cases) if jobs == 1 else in_processes(work, cases, jobs)
    for number, outcome in enumerate(found, 1):
        name = outcome.case.name
        try:
            for path in set(written) - outcome.files.keys():
                (out / name / path).unlink(missing_ok=True)
            for path, content in outcome.files.items():
                (out / name / path).parent.mkdir(parents=True, exist_ok=True)
                with replaced_bytes(out / name / path) as file:
                    file.write(content)
        except OSError as error:
            raise ConfigError(f"--out {out / name}: cannot be written ({error.strerror})") from None
        if outcome.error:
            failed.append(FailedCase(case=name, status=outcome.status, error=outcome.error))
        row = {"case": name, "command": command, "status": float(outcome.status)}
        row |= {"traces": json.dumps([str(path) for path in outcome.case.traces])}
        row |= {"error": outcome.error or None}
        row |= {f"answer_{key}": value for key, value in _plain(outcome.document)}
        rows.append(row | {"document": json.dumps(outcome.document) if outcome.document else None})
        progress(f"{number} of {len(cases)}: {name}, {len(failed)} without an answer")
    write_table(out / TABLE, rows)
    failed.sort(key=lambda each: each.case)
    answered = len(cases) - len(failed)
    words = [f"{out / TABLE}: {answered} of {len(cases)} cases answered"]
    words += [f"{each.case}: {each.error}" for each in failed[:10]]
    words += [f"and {len(failed) - 10} more without an answer"] if len(failed) > 10 else []
    worst = (exit_status.INTERNAL_FAILURE, exit_status.BAD_INPUT, exit_status.BAD_DATA)
    statuses = {each.status for each in failed}
    status = next((each for each in worst if each in statuses), exit_status.DONE)
    document = BatchDocument(
        command=command,
        cases=len(cases),
        answered=answered,
        table=str(out / TABLE),
        failed=failed,
    )
    return Answer("\n".join(words), document, status)


def cases_of(given: Sequence[Path]) -> list[Case]:
    """Cases in the order given, no two of a name. Raises ConfigError: nothing is there."""
    cases: dict[str, Case] = {}
    for path in given:
        if not path.exists():
            raise ConfigError(f"{path}: no such file or folder")
        found = [path] if path.is_file() else sorted(filter(is_recording, path.iterdir()))
        if not found:
            raise ConfigError(f"{path}: no recording in it; expected a file or a folder with some")
        name = path.stem if path.is_file() else path.resolve().name
        alike = (name if number == 1 else f"{name}_{number}" for number in count(1))
        name = next(each for each in alike if each not in cases)
        cases[name] = Case(name, tuple(each.resolve() for each in found))
    return list(cases.values())


def in_processes(work: Work, cases: Sequence[Case], jobs: int) -> Iterator[Outcome]:
    """Outcomes as they come; a case whose process dies, and takes the pool along, runs again."""
    broken = []
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        futures = {pool.submit(done, work, case): case for case in cases}
        try:
            for future in as_completed(futures):
                if isinstance(future.exception(), BrokenProcessPool):
                    broken.append(futures[future])
                else:
                    yield _outcome(future, futures[future])
        finally:
            pool.shutdown(cancel_futures=True)
    for case in broken:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            yield _outcome(pool.submit(done, work, case), case)


def done(work: Work, case: Case) -> Outcome:
    """Work on a case in a folder of its own; what is wrong with it is no error here."""
    document: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base) / case.name
        folder.mkdir()
        try:
            answer = work(case.traces, folder)
            status, error = answer.status, ""
            document = json.loads(answer.as_json().replace(f"{base}{os.sep}", ""))
        except BadDataError as refused:
            status, error = exit_status.BAD_DATA, str(refused).replace(f"{base}{os.sep}", "")
        except (ConfigError, TraceError, DiagnosisError, FingerprintError) as refused:
            status, error = exit_status.BAD_INPUT, str(refused)
        except OSError as refused:
            status, error = exit_status.BAD_INPUT, f"{case.name}: {refused.strerror or refused}"
        except Exception as failure:
            log.exception("%s", case.name)
            status, error = exit_status.INTERNAL_FAILURE, _failure(case, failure)
        files = {
            str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
    return Outcome(case, status, error, document, files)


def _failure(case: Case, error: BaseException) -> str:
    words = " ".join(str(error).split())[:200]
    return f"{case.name}: internal failure: {type(error).__name__}: {words}"


def _outcome(future: Any, case: Case) -> Outcome:
    """Outcome of a future here or on a cluster; a case that ends its process has none."""
    if (error := future.exception()) is not None:
        return Outcome(case, exit_status.INTERNAL_FAILURE, _failure(case, error))
    outcome: Outcome = future.result()
    return outcome


def on_cluster(
    work: Work, cases: Sequence[Case], address: str, *, insecure: bool = False
) -> Iterator[Outcome]:
    """Outcomes as they come, of workers that see the same files. Raises ConfigError."""
    if not address.startswith(("tcp://", "tls://")):
        raise ConfigError(f"--cluster {address}: expected tls://HOST:PORT (or --jobs N, here)")
    if address.startswith("tcp://") and not insecure:
        raise ConfigError(
            f"--cluster {address}: whoever reaches it can run programs there; "
            "expected tls://HOST:PORT, or --insecure on a network of your own"
        )
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise ConfigError(f"--cluster: `pip install edge-service[cluster]` ({error})") from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (TimeoutError, OSError, ValueError, TypeError) as error:
        raise ConfigError(f"--cluster {address}: no scheduler answers there ({error})") from None
    with client:
        there, here = client.run(version, "edge-service"), version("edge-service")
        if not there:
            raise ConfigError(f"--cluster {address}: it has no workers")
        for worker, installed in there.items():
            if installed != here:
                raise ConfigError(
                    f"--cluster {address}: worker {worker} has version {installed}, expected {here}"
                )
        # a scheduler gives everybody who asks for a known key its result: each key is new
        futures = {
            client.submit(done, work, case, key=f"{case.name}-{uuid4().hex}"): case
            for case in cases
        }
        for future in distributed.as_completed(futures):
            yield _outcome(future, futures[future])
            future.release()


def _plain(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers, texts and flags of a document by the path that leads to them; no lists."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from _plain(value, f"{prefix}{name}_")
        elif isinstance(value, bool | str | int | float):
            yield prefix + name, float(value) if type(value) is int else value


def write_table(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows by name of their case; what a row lacks is null, mixed kinds become texts."""
    import pyarrow as pa
    import pyarrow.parquet

    ordered = sorted(rows, key=lambda row: str(row["case"]))
    answers = sorted({name for row in ordered for name in row if name.startswith("answer_")})
    columns = {}
    for name in ["case", "command", "traces", "status", "error", *answers, "document"]:
        values = [row.get(name) for row in ordered]
        kinds = {type(value) for value in values if value is not None}
        if kinds in ({float}, {bool}):
            columns[name] = pa.array(values)
        else:
            columns[name] = pa.array([v if v is None else str(v) for v in values], pa.string())
    with replaced_bytes(path) as file:
        pyarrow.parquet.write_table(pa.table(columns), file)
