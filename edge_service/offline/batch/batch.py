"""A command over many recordings: a folder of results for each, one table of all."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ... import exit_status
from ...atomic import replaced_bytes
from ...command_answer import Answer
from ...config import ConfigError
from ..document import Document
from ..recordings import Progress, silent
from .cases import cases_of
from .cluster import on_cluster, serial
from .table import row_of, write_table
from .work import WRITTEN, Outcome, Task

TABLE = "table.parquet"


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


def run_batch(
    task: Task,
    given: Sequence[Path],
    out: Path,
    cluster: str | None = None,
    workers: int | None = None,
    progress: Progress = silent,
) -> Answer:
    """Write `out/CASE/` for every case and `out/table.parquet`; returns a summary.

    Args:
        given: recordings, and folders with those of one session each.
        cluster: see `on_cluster`; None works in this process.

    Raises:
        ConfigError: a path or a cluster is not there, or nothing can be written.
    """
    cases = cases_of(given)
    outcomes = serial(task, cases) if cluster is None else on_cluster(task, cases, cluster, workers)
    rows, failed = [], []
    progress(f"0 of {len(cases)}")
    for count, outcome in enumerate(outcomes, 1):
        _keep(outcome, out / outcome.case.name, WRITTEN[task.command])
        rows.append(row_of(task.command, outcome))
        if outcome.error:
            each = FailedCase(case=outcome.case.name, status=outcome.status, error=outcome.error)
            failed.append(each)
        progress(f"{count} of {len(cases)}: {outcome.case.name}, {len(failed)} without an answer")
    write_table(out / TABLE, rows)
    failed.sort(key=lambda each: each.case)
    document = BatchDocument(
        command=task.command,
        cases=len(cases),
        answered=len(cases) - len(failed),
        table=str(out / TABLE),
        failed=failed,
    )
    return Answer(_words(document), document, _status(failed))


def _keep(outcome: Outcome, folder: Path, written: Sequence[str]) -> None:
    """Write what a case left, each file whole or not at all. Raises ConfigError.

    What an earlier run left and this one did not is removed: it would pass for the answer of today.
    """
    try:
        for name in set(written) - outcome.files.keys():
            (folder / name).unlink(missing_ok=True)
        for name, content in outcome.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with replaced_bytes(path) as file:
                file.write(content)
    except OSError as error:
        raise ConfigError(f"--out {folder}: cannot be written ({error.strerror})") from None


def _status(failed: Sequence[FailedCase]) -> int:
    """Of the worst case: a failure of ours, then bad input, then recordings that are unfit."""
    for status in (exit_status.INTERNAL_FAILURE, exit_status.BAD_INPUT, exit_status.BAD_DATA):
        if any(each.status == status for each in failed):
            return status
    return exit_status.DONE


def _words(document: BatchDocument) -> str:
    lines = [f"{document.table}: {document.answered} of {document.cases} cases answered"]
    kinds = Counter(each.status for each in document.failed)
    if kinds:
        lines.append(f"{sum(kinds.values())} without an answer; the column `error` says why:")
        lines += [f"  {each.case}: {each.error}" for each in document.failed[:10]]
        if len(document.failed) > 10:
            lines.append(f"  and {len(document.failed) - 10} more")
    return "\n".join(lines)
