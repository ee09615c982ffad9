"""Processor time and memory of a process with all that it has started."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

_KIB = 1024


@dataclass(frozen=True, slots=True)
class TreeUsage:
    """Resources of a tree of processes.

    Attributes:
        cpu_s: of all that live, and of those that they have waited for, s.
        own_mb: resident memory of the first process, MB.
        shared_mb: proportional set size of all, MB: what two share counts half in each.
    """

    cpu_s: float
    own_mb: float
    shared_mb: float


def usage_of(pid: int) -> TreeUsage:
    """Resources now, from Linux' /proc."""
    pids = _tree(pid)
    own = _kib(Path(f"/proc/{pid}/status"), "VmRSS")
    shared = sum(_kib(Path(f"/proc/{each}/smaps_rollup"), "Pss") for each in pids)
    return TreeUsage(sum(map(_cpu_s, pids)), own * _KIB / 1e6, shared * _KIB / 1e6)


def _tree(pid: int) -> list[int]:
    found = [pid]
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in _text(task / "children").split():
            found += _tree(int(child))
    return found


def _cpu_s(pid: int) -> float:
    """User and system time of a process and of its children that have ended, s."""
    fields = _text(Path(f"/proc/{pid}/stat")).rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def _kib(path: Path, name: str) -> int:
    found = re.search(rf"^{name}:\s+(\d+) kB$", _text(path), re.MULTILINE)
    return int(found[1]) if found else 0


def _text(path: Path) -> str:
    """Content of a file of /proc; empty where its process has ended meanwhile."""
    try:
        return path.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""
