"""One fault a room, seeded into a copy of the checkout; the room's fast tests must turn red.

    python -m tests.seeded_faults [ROOM ...]

A fault is a line as it is and as it must not be, found by its text in the room. Exit status 1 where
a fault is not found or its line is no longer there.
"""

import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .bench.table import Table
from .programs import ran

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True, slots=True)
class Fault:
    """A line of a room, the wrong one in its place, and the tests to find it (blanks between)."""

    room: str
    right: str
    wrong: str
    tests: str


FAULTS = (
    Fault(
        "messages",
        "math.floor(round(low * scale, 6))",
        "math.ceil(round(low * scale, 6))",
        "tests/messages",
    ),
    Fault("bus", "self.lost += step - 1", "self.lost += step", "tests/bus"),
    Fault(
        "models",
        "CATALOGUE_PRELOAD_PERCENT, 1.0 / 3.0)",
        "CATALOGUE_PRELOAD_PERCENT, 1.0 / 2.0)",
        "tests/models/screw",
    ),
    Fault(
        "regression",
        "variance = times * np.sum(scores**2, axis=0) * freedom",
        "variance = np.sum(scores**2, axis=0) * freedom",
        "tests/fingerprint",
    ),
    Fault(
        "recordings",
        "LARGEST_HOLE = 4.5",
        "LARGEST_HOLE = 45.0",
        "tests/fingerprint/test_preparation.py tests/recordings",
    ),
    Fault(
        "checks",
        "if low > 1.0 + FACTOR_TOLERANCE or high < 1.0 - FACTOR_TOLERANCE:",
        "if low > 1.0 + FACTOR_TOLERANCE:",
        "tests/adopt/test_judged_factor.py tests/adopt",
    ),
    Fault(
        "downsample",
        "return mean / duration, moment / (2.0 * duration * duration)",
        "return mean / duration, moment / (duration * duration)",
        "tests/downsample",
    ),
    Fault(
        "estimate",
        "p[i, j] -= a * first[j] + b * second[j]",
        "p[i, j] -= a * first[j]",
        "tests/estimate",
    ),
    Fault(
        "health",
        "limits.warning_percent, limits.warning_percent + margin",
        "limits.fault_percent, limits.fault_percent + margin",
        "tests/health",
    ),
    Fault(
        "http_api",
        'if caller.role == "viewer" and request.method not in SAFE_METHODS:',
        'if caller.role == "viewer" and request.method in SAFE_METHODS:',
        "tests/http_api",
    ),
    Fault(
        "nodes",
        "if axis in axes and event.kind == PART_REPLACED:",
        "if axis in axes and event.kind != PART_REPLACED:",
        "tests/nodes",
    ),
    Fault(
        "outputs",
        "number = value_at(answer, path) if answer.is_heard else None",
        "number = value_at(answer, path)",
        "tests/outputs",
    ),
    Fault(
        "fingerprint",
        "level, level + excess, scale, viscous)",
        "level, level - excess, scale, viscous)",
        "tests/fingerprint",
    ),
    Fault(
        "diagnose",
        "return self.beyond(channel, rms) > self.tolerance[channel]",
        "return self.beyond(channel, rms) > 0.0",
        "tests/diagnose",
    ),
    Fault(
        "offline",
        "DOUBTED = 1",
        "DOUBTED = 0",
        "tests/adopt tests/test_cli.py tests/test_cli_drivers.py",
    ),
    Fault(
        "config",
        "if config is None or mistakes:",
        "if config is None and mistakes:",
        "tests/test_configuration.py",
    ),
    Fault(
        "cli",
        "return error.format_message(), BAD_INPUT",
        "return error.format_message(), DONE",
        "tests/test_cli.py",
    ),
    Fault(
        "drivers", 'word.to_bytes(2, "big")', 'word.to_bytes(2, "little")', "tests/drivers/modbus"
    ),
)


def place_of(fault: Fault, checkout: Path) -> Path | None:
    """File of the room that holds the line; None if none or several do."""
    folder = checkout / ("drivers" if fault.room == "drivers" else f"edge_service/{fault.room}")
    found = [path for path in folder.rglob("*.py") if fault.right in path.read_text("utf-8")]
    return found[0] if len(found) == 1 else None


def outcome(fault: Fault, checkout: Path) -> tuple[str, str]:
    """Outcome of the tests in words, and the first test that failed."""
    path = place_of(fault, checkout)
    if path is None:
        return "line not there", ""
    text = path.read_text("utf-8")
    path.write_text(text.replace(fault.right, fault.wrong, 1), "utf-8")
    line = ["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", "not slow"]
    line += fault.tests.split()
    done = ran(sys.executable, *line, folder=checkout, PYTHONPATH=str(checkout))
    path.write_text(text, "utf-8")
    failed = [
        each
        for each in done.stdout.splitlines()
        if each.startswith(("FAILED tests", "ERROR tests"))
    ]
    if done.returncode == 1 and failed:
        return "found", failed[0].split()[1].rpartition("::")[2].partition("[")[0]
    return ("not found" if done.returncode == 0 else f"status {done.returncode}"), ""


def main(rooms: Sequence[str]) -> int:
    """Seed the faults of some rooms, or of all, and print a table."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="seeded-faults-") as name:
        checkout = Path(name) / "checkout"
        kept_out = shutil.ignore_patterns(".git", ".venv", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, checkout, ignore=kept_out)
        for fault in FAULTS:
            if not rooms or fault.room in rooms:
                begun_s = time.monotonic()
                said, test = outcome(fault, checkout)
                spent = f"{time.monotonic() - begun_s:.0f} s"
                rows.append((fault.room, fault.wrong.strip(), said, test, spent))
                sys.stderr.write("  ".join(rows[-1]) + "\n")
    sys.stdout.write(f"{Table(('room', 'fault', 'outcome', 'first test', 'after'), tuple(rows))}\n")
    return 0 if rows and all(row[2] == "found" for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
