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

    def simulated(motion: str, seed: int, preload: float = 5.0) -> Path:
        whole, trace = tmp_path / "whole.csv", tmp_path / f"{motion[:5]}_{seed}.csv"
        settings = ("--seed", str(seed), "--preload", str(preload), "--out", whole)
        run("simulate", "--machine", machine, "--motion", motion, *settings)
        with whole.open() as lines, trace.open("w") as out:
            kept = [row[:3] + row[6:7] for row in csv.reader(lines)]
            csv.writer(out).writerows(kept)  # without the linear encoder
        return trace

    healthy = simulated("production:duration_s=60", 5)
    tests = [word for seed in (1, 2, 3) for word in ("--test", simulated("chirp", seed))]
    said = run(
        "commission", healthy, *tests, "--machine", machine, "--assume-fresh", "--out", learned
    )
    assert "by 3 tests" in said
    twice = ("commission", healthy, *tests[:2], *tests[:2], "--machine", machine, "--assume-fresh")
    refused = CliRunner().invoke(cli, [*map(str, twice), "--out", str(tmp_path / "no.toml")])
    assert "the same recording twice" in str(refused.exception)
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
    words = ("commission", healthy, "--test", healthy, "--machine", machine, "--assume-fresh")
    refused = CliRunner().invoke(cli, [*map(str, words), "--out", str(tmp_path / "no.toml")])
    assert "nothing shakes the axis on a slow feed" in str(refused.exception)
