"""Records of jobs that outlive the service: one JSON file beside each job's folder."""

import logging
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from ...atomic import DamagedError, read_checked, set_aside, write_checked
from ...http_api.jobs import JobAnswer, JobState

log = logging.getLogger(__name__)
_SUFFIX = ".json"
INTERRUPTED = "the service stopped before the job was done"


def save_job(out: Path, answer: JobAnswer) -> None:
    """Remember a job whose files are in the folder `out`; a full disk is logged."""
    try:
        write_checked(_record(out), answer.model_dump_json())
    except OSError as error:
        log.warning("%s: the record of the job cannot be saved (%s)", out, error.strerror)


def forget_job(out: Path) -> None:
    """Remember it no longer."""
    with suppress(OSError):  # it is read again at the next start, and then forgotten
        _record(out).unlink(missing_ok=True)


def known_jobs(folder: Path) -> Sequence[tuple[Path, JobAnswer]]:
    """Jobs of earlier runs with their folders, by number; what ran then has failed."""
    jobs = []
    for path in folder.glob(f"[!.]*{_SUFFIX}"):
        try:
            answer = JobAnswer.model_validate_json(read_checked(path) or "")
        except (OSError, DamagedError, ValidationError) as error:
            log.warning("%s: not a valid record of a job (%s)", path, type(error).__name__)
            with suppress(OSError):
                set_aside(path)
            continue
        if answer.state is JobState.RUNNING:
            lines = [*answer.lines, INTERRUPTED]
            answer = answer.model_copy(update={"state": JobState.FAILED, "lines": lines})
        jobs.append((path.with_suffix(""), answer))
    return sorted(jobs, key=lambda each: each[1].id)


def _record(out: Path) -> Path:
    return out.with_name(out.name + _SUFFIX)
