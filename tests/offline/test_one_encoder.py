"""Commands for an axis with one encoder: commissioned with tests, estimated by another."""

import csv
from pathlib import Path

import pytest
from click.testing import CliRunner

from edge_service.cli.entry import cli
from edge_service.config import load_machine

from ..documents import blocks, document

COLUMNS = """
[columns]
time_s = "time_s"
torque_command_nm = "torque_command_nm"
motor_angle_rad = "motor_angle_rad"
position_setpoint_m = "position_setpoint_m"
"""


def run(*words: str | Path) -> str:
    done = CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.slow
def test_the_commands_lead_from_tests_to_a_preload(tmp_path: Path) -> None:
    machine, learned, state = (tmp_path / name for name in ("m.toml", "c.toml", "x.json"))
    machine.write_text(blocks(document("deploy/FIRST_MACHINE.md"), "toml")[0] + COLUMNS)

    both = tmp_path / "both.csv"

    def simulated(motion: str, seed: int, preload: float = 5.0, begin_s: float = 0.0) -> Path:
        trace = tmp_path / f"{motion[:5]}_{seed}.csv"
        settings = ("--seed", str(seed), "--preload", str(preload), "--out", both)
        run("simulate", "--machine", machine, "--motion", motion, *settings)
        with both.open() as lines, trace.open("w") as out:
            head, *rows = [row[:3] + row[6:7] for row in csv.reader(lines)]
            rows = [[str(float(row[0]) + begin_s), *row[1:]] for row in rows]
            csv.writer(out).writerows([head, *rows])  # without the linear encoder
        return trace

    def commissioned(trace: Path, *tests: Path, out: str = "no.toml") -> str:
        """Answer, or the reason why there is none."""
        given = [word for test in tests for word in ("--test", test)]
        words = ("commission", trace, *given, "--machine", machine, "--assume-fresh")
        done = CliRunner().invoke(cli, [*map(str, words), "--out", str(tmp_path / out)])
        return str(done.exception or done.output)

    tests = [simulated("chirp", seed) for seed in (1, 2, 3)]
    days = [simulated("chirp", seed, begin_s=1.8e9 + 3e4 * seed) for seed in (4, 6, 7)]
    healthy = simulated("production:duration_s=60", 5)
    said = commissioned(healthy, *tests, out=learned.name)
    assert "by 3 tests" in said
    assert "the days of the tests are not known: own clocks" in said
    said = commissioned(healthy, *days[:2])
    assert "by 2 tests" in said
    assert "own clocks" not in said
    for one_day in ((*tests[:2], *tests[:2]), days[1:]):
        assert "the same recording twice, or two of one day" in commissioned(healthy, *one_day)
    assert "nothing shakes the axis on a slow feed" in commissioned(healthy, healthy)
    machine.write_text(machine.read_text().removesuffix(COLUMNS))
    assert "two encoders show the stiffness" in commissioned(both, tests[0])
    known = load_machine(learned).commissioned
    assert known is not None
    assert known.notch is not None
    read = []
    for preload in (5.0, 2.5, 1.25):
        out = tmp_path / "e.csv"
        test = simulated("chirp", 7, preload)
        said = run("estimate", test, "--machine", learned, "--state", state, "--out", out)
        assert "1 blocks, last status estimated by a test of shaking" in said
        (row,) = csv.DictReader(out.read_text().splitlines())
        assert row["status"] == "estimated"
        assert float(row["low"]) <= preload <= float(row["high"])
        read.append(float(row["preload_percent"]))
    assert read == sorted(read, reverse=True)
