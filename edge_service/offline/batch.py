"""A command over many recordings: a folder of results a case, and one table of all."""

import json
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextvars import Context
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from importlib.metadata import version
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from .. import exit_status
from ..atomic import made_folder, replaced_bytes
from ..command_answer import Answer, progress
from ..config import ConfigError
from ..recordings.forms import is_recording

log = logging.getLogger(__name__)
TABLE = "table.parquet"
CONNECT_S = 10.0
Work = Callable[[Sequence[Path], Path], Answer]
"""Work on the recordings of a case, which writes into a folder."""


@dataclass(frozen=True, slots=True)
class Case:
    """Recordings of one axis and one session, and the name of their folder among the results."""

    name: str
    traces: tuple[Path, ...]


@dataclass(frozen=True, slots=True)
class CaseOutcome:
    """Exit status, mistake in one line, and document that a command left."""

    case: Case
    status: int
    error: str = ""
    document: dict[str, Any] = field(default_factory=dict)


def run_batch(
    command: str,
    work: Work,
    written: Sequence[str],
    given: Sequence[Path],
    out: Path,
    jobs: int = 1,
    cluster: str | None = None,
    insecure: bool = False,
) -> Answer:
    """Write `out/CASE/` for every case and `out/table.parquet`; returns a summary.

    Args:
        work: a picklable function; what is wrong with one case stops no other.
        written: files of `work`; those of an earlier run are removed.
        cluster: tls://HOST:PORT of a Dask scheduler, or with `insecure` tcp://HOST:PORT; its
            workers see the same files.

    Raises ConfigError: a path or a cluster is not there, or nothing can be written.
    """
    cases, rows, failed = cases_of(given), [], []
    each_done = partial(done, work, written, out.resolve())
    if cluster is not None:
        found = on_cluster(each_done, cases, cluster, insecure=insecure)
    else:
        found = map(each_done, cases) if jobs == 1 else in_processes(each_done, cases, jobs)
    for number, outcome in enumerate(found, 1):
        name, document = outcome.case.name, outcome.document
        if outcome.error:
            failed.append({"case": name, "status": outcome.status, "error": outcome.error})
        row = {"case": name, "command": command, "status": float(outcome.status)}
        row |= {"traces": json.dumps([str(path) for path in outcome.case.traces])}
        row |= {"error": outcome.error or None}
        said = {f"answer_{key}": each for key, each in flat(document)}
        row |= {key: each for key, each in said.items() if not isinstance(each, list | None)}
        rows.append(row | {"document": json.dumps(document) if document else None})
        progress(f"{number} of {len(cases)}: {name}, {len(failed)} without an answer")
    write_table(out / TABLE, rows)
    failed.sort(key=lambda each: str(each["case"]))
    answered = len(cases) - len(failed)
    words = [f"{out / TABLE}: {answered} of {len(cases)} cases answered"]
    words += [f"{each['case']}: {each['error']}" for each in failed[:10]]
    words += [f"and {len(failed) - 10} more without an answer"] if len(failed) > 10 else []
    worst = (exit_status.INTERNAL_FAILURE, exit_status.BAD_INPUT, exit_status.BAD_DATA)
    statuses = {each["status"] for each in failed}
    status = next((each for each in worst if each in statuses), exit_status.DONE)
    document = {"command": command, "cases": len(cases), "answered": answered}
    document |= {"table": str(out / TABLE), "failed": failed}
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


def done(work: Work, written: Sequence[str], out: Path, case: Case) -> CaseOutcome:
    """Work on a case into its folder; what is wrong with it is no error here."""
    folder = out / case.name
    try:
        made_folder(folder)
        for name in written:
            (folder / name).unlink(missing_ok=True)  # of an earlier run
        answer = Context().run(work, case.traces, folder)  # whose stages nobody is told
        document = json.loads(answer.as_json().replace(f"{out}{os.sep}", ""))
        return CaseOutcome(case, answer.status, document=document)
    except exit_status.BadInputError as refused:
        return CaseOutcome(case, refused.status, str(refused).replace(f"{out}{os.sep}", ""))
    except OSError as refused:
        error = f"{refused.filename or case.name}: {refused.strerror or refused}"
        return CaseOutcome(case, exit_status.BAD_INPUT, error)
    except Exception as failure:
        log.exception("%s", case.name)
        return _failed(case, failure)


def _failed(case: Case, error: BaseException) -> CaseOutcome:
    words = " ".join(str(error).split())[:200]
    said = f"{case.name}: internal failure: {type(error).__name__}: {words}"
    return CaseOutcome(case, exit_status.INTERNAL_FAILURE, said)


def in_processes(
    each_done: Callable[[Case], CaseOutcome], cases: Sequence[Case], jobs: int
) -> Iterator[CaseOutcome]:
    """Outcomes as they come; a case whose process dies, and takes the pool along, runs again."""
    broken = []
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        futures = {pool.submit(each_done, case): case for case in cases}
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
            yield _outcome(pool.submit(each_done, case), case)


def _outcome(future: Future[CaseOutcome], case: Case) -> CaseOutcome:
    """CaseOutcome of a future here or on a cluster; a case that ends its process has none."""
    error = future.exception()
    return future.result() if error is None else _failed(case, error)


def on_cluster(
    each_done: Callable[[Case], CaseOutcome],
    cases: Sequence[Case],
    address: str,
    *,
    insecure: bool = False,
) -> Iterator[CaseOutcome]:
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
        raise ConfigError(f"--cluster: {error}; expected the package `distributed`") from None
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
        # a scheduler gives everybody who asks for a known key its result: none is known
        pool = client.get_executor(pure=False)
        futures = {pool.submit(each_done, case): case for case in cases}
        for future in as_completed(futures):
            yield _outcome(future, futures[future])


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Members of a document by the path that leads to them; numbers as float."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{name}_")
        else:
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
