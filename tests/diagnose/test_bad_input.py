"""Recordings unfit for `gap` and `diagnose`: a clear line or verdict, never a traceback."""

import json
import resource
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from edge_service.cli.entry import main
from tests.programs import ran

from ..bench.real_machines import written
from .conftest import diagnosed, recorded


def sound() -> dict[str, np.ndarray]:
    return dict(recorded((), seed=3).columns)


def test_three_seconds_name_nothing_and_say_that_they_are_short(machine_file, tmp_path):
    columns = {name: each[:3000] for name, each in sound().items()}
    document = diagnosed(machine_file, tmp_path, written(tmp_path / "a.csv", columns))
    assert (document["verdict"], document["effects"]) == ("no_gap", [])
    assert any("of motion in all" in each for each in document["remarks"])


@pytest.mark.slow
@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_two_hours_in_bounded_memory(machine_file, tmp_path, capsys, form):
    """The same forty seconds again and again have the gap of the forty seconds.

    The peak is that of VmHWM: a process' ru_maxrss begins with that of the one it was forked from.
    """
    columns = {name: sound()[name] for name in ("torque_command_nm", "motor_angle_rad")}
    rows = len(columns["torque_command_nm"])
    path = tmp_path / f"long.{form}"
    with tiled(path, columns) as write:
        for repeat in range(7200 * 1000 // rows):
            write(repeat * (rows * 1e-3 + 1.0) + 1e-3 * np.arange(rows))
    script = (
        "import sys; from edge_service.cli.entry import main; code = main(sys.argv[1:]);"
        "status = dict(line.split(':', 1) for line in open('/proc/self/status'));"
        "print(status['VmHWM'].split()[0], file=sys.stderr); sys.exit(code)"
    )
    command = ["gap", "--machine", str(machine_file), str(path), "--json"]
    done = ran(sys.executable, "-c", script, *command)
    assert done.returncode == 0
    once = written(tmp_path / "once.csv", {"time_s": sound()["time_s"], **columns})
    assert main(["gap", "--machine", str(machine_file), once, "--json"]) == 0
    expected = json.loads(capsys.readouterr().out)
    assert json.loads(done.stdout) == pytest.approx(expected, rel=5e-3)
    assert int(done.stderr.splitlines()[-1]) < 700_000


@contextmanager
def tiled(path: Path, columns: dict[str, np.ndarray]) -> Iterator[Callable[[np.ndarray], None]]:
    """Writes the same columns again and again, each time at times that are given."""
    schema = pa.schema([(name, pa.float64()) for name in ("time_s", *columns)])
    kind = pyarrow.csv.CSVWriter if path.suffix == ".csv" else pyarrow.parquet.ParquetWriter
    with kind(path, schema) as writer:
        yield lambda at_s: writer.write_table(pa.table([at_s, *columns.values()], schema=schema))


@pytest.mark.slow
def test_many_short_files_are_one_session(machine_file, tmp_path):
    """More files than a process may hold open, each of a second and a half."""
    columns = sound()
    names = ("time_s", "torque_command_nm", "motor_angle_rad", "table_position_m")
    starts = np.arange(0, len(columns["time_s"]) - 1500, 1500)
    files = [
        written(tmp_path / f"{k}.csv", {name: columns[name][k : k + 1500] for name in names})
        for k in starts
    ]
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    few = len(list(Path("/proc/self/fd").iterdir())) + 15
    resource.setrlimit(resource.RLIMIT_NOFILE, (few, hard))
    try:
        document = diagnosed(machine_file, tmp_path, *files)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert (document["verdict"], document["effects"]) == ("no_gap", [])
