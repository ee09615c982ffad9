"""Work on one case, wherever it is done: a command's function, its answer and its files."""

import json
import logging
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ... import exit_status
from ...command_answer import Answer
from ...config import DEFAULT_CONFIG, ConfigError, load_config
from ...fingerprint.document import FingerprintError
from ...recordings.columns import TraceError
from ..diagnosis.sessions import BadDataError, DiagnosisError
from .cases import Case

log = logging.getLogger(__name__)
_REFUSALS = (ConfigError, TraceError, DiagnosisError, FingerprintError)
"""Mistake in a case, in one line."""


@dataclass(frozen=True, slots=True)
class Task:
    """A command with the options that hold for every case.

    Attributes:
        command: "diagnose", "fingerprint" or "estimate".
        machine: the machine file.
        reference: recordings of the healthy machine, of a diagnosis.
        config: the service's configuration, of an estimate.
    """

    command: str
    machine: Path
    axis_number: int | None = None
    reference: tuple[Path, ...] = ()
    config: Path | None = None


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one case.

    Attributes:
        status: exit status that the command alone would have had.
        error: what was wrong, in one line; empty if nothing was.
        document: the command's answer; empty without one.
        files: content of what it wrote, by path below the case's folder.
        worker: process that did it.
        took_s: how long it took, s.
    """

    case: Case
    status: int
    error: str = ""
    document: dict[str, Any] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    worker: str = ""
    took_s: float = 0.0


def done(task: Task, case: Case) -> Outcome:
    """Do the work of a case in a folder of its own; what is wrong with it is no error here."""
    begun_s = time.monotonic()
    document: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base) / case.name
        folder.mkdir()
        try:
            answer = _COMMANDS[task.command](task, case, folder)
            status, error = answer.status, ""
            document = json.loads(answer.as_json().replace(f"{base}{os.sep}", ""))
        except BadDataError as refused:
            status, error = exit_status.BAD_DATA, str(refused).replace(f"{base}{os.sep}", "")
        except _REFUSALS as refused:
            status, error = exit_status.BAD_INPUT, str(refused)
        except OSError as refused:
            status, error = exit_status.BAD_INPUT, f"{case.name}: {refused.strerror or refused}"
        except Exception as failure:
            log.exception("%s", case.name)
            words = " ".join(str(failure).split())[:200]
            status = exit_status.INTERNAL_FAILURE
            error = f"{case.name}: internal failure: {type(failure).__name__}: {words}"
        files = {
            str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file()
        }
    took_s, worker = time.monotonic() - begun_s, f"{os.uname().nodename}:{os.getpid()}"
    return Outcome(case, status, error, document, files, worker, took_s)


def _diagnose(task: Task, case: Case, folder: Path) -> Answer:
    from ..diagnosis.diagnose import diagnose

    return diagnose(
        task.machine,
        case.traces,
        folder,
        reference=task.reference,
        axis_number=task.axis_number,
    )


def _fingerprint(task: Task, case: Case, folder: Path) -> Answer:
    from ..fingerprint import fingerprint

    return fingerprint(task.machine, case.traces, folder, axis_number=task.axis_number)


def _estimate(task: Task, case: Case, folder: Path) -> Answer:
    from ..estimate import estimate_to_csv

    if len(case.traces) > 1:
        raise ConfigError(f"{case.name}: estimate takes one recording a case, not a folder")
    config = load_config(task.config or DEFAULT_CONFIG)
    out = folder / "estimates.csv"
    return estimate_to_csv(case.traces[0], task.machine, out, config, axis_number=task.axis_number)


WRITTEN = {
    "diagnose": ("diagnosis.json", "augmented.toml", "report.html"),
    "fingerprint": ("fingerprint.json", "report.html"),
    "estimate": ("estimates.csv",),
}
"""Files that each command writes."""
_COMMANDS: dict[str, Callable[[Task, Case, Path], Answer]] = {
    "diagnose": _diagnose,
    "fingerprint": _fingerprint,
    "estimate": _estimate,
}
