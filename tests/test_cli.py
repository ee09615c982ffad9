"""Every mistake of a user is one clear line and exit status 2; nothing is half-written."""

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from edge_service.cli.entry import cli, main
from edge_service.cli.twin import benchmarks
from edge_service.exit_status import BAD_INPUT, DONE, BadInputError

COMMANDS = sorted(cli.commands)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_helps_with_an_example(command: str) -> None:
    result = CliRunner().invoke(cli, [command, "--help"])
    assert result.exit_code == 0
    assert "Example: edge-service" in " ".join(result.output.split())


def write(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


def private(folder: Path, name: str, text: str) -> str:
    """A file that its owner alone may read."""
    path = write(folder, name, text)
    Path(path).chmod(0o600)
    return path


KEPT = '[store]\nfolder = "state"\n[[axes]]\nname = "X"\n'
AXIS = '[[axes]]\nname = "X"\n'
TRACE = "time_s,torque_command_nm,motor_angle_rad\n0,1,2\n0.001,1,2\n"
Case = Callable[[Path], list[str]]
TWO_MOTIONS = ["simulate", "--motion", "standstill", "--motion", "standstill"]
CASES: dict[str, tuple[Case, str]] = {
    "one duration for two motions": (
        lambda p: [*TWO_MOTIONS, "--duration", "9", "--out", str(p / "runs")],
        "--duration: with several motions expected NAME:duration_s=SECONDS",
    ),
    "a method that is none": (
        lambda p: ["estimate", write(p, "t.csv", TRACE), "--out", "o.csv", "--method", "kf"],
        "--method: no estimator 'kf'; there are auto, ",
    ),
    "a data sheet that is none": (
        lambda p: ["adopt", write(p, "t.csv", TRACE), "--out", "m.toml", "--screw", "20"],
        "--screw '20': expected \"DIAMETERxLEAD C... P...\"",
    ),
    "a key that no machine file has": (
        lambda p: ["adopt", write(p, "t.csv", TRACE), "--out", "m.toml", "--set", "leed_m=1"],
        "--set leed_m=1: no key of a machine file; did you mean lead_m?",
    ),
    "a unit of something else": (
        lambda p: ["adopt", write(p, "t.csv", TRACE), "--out", "m.toml", "--set", "lead_m=1kg"],
        "--set lead_m=1kg: 'kg' is no unit of lead_m",
    ),
    "a motion without a name": (
        lambda p: ["motion", "--out", str(p / "motions.csv")],
        "motion: --out goes with the NAME of a motion",
    ),
    "missing configuration": (lambda p: ["check-config", str(p / "no.toml")], "no such file"),
    "no toml": (lambda p: ["check-config", write(p, "a.toml", "x = = 1")], "is not valid TOML"),
    "unknown key with a hint": (
        lambda p: ["check-config", write(p, "a.toml", AXIS + "[http]\nprot = 1")],
        "http.prot: unknown key; did you mean http.port?",
    ),
    "missing driver key": (
        lambda p: ["check-config", write(p, "a.toml", AXIS + 'driver = "modbus"')],
        "a.toml: axes.X.settings.url: missing",
    ),
    "unknown driver": (
        lambda p: ["check-config", write(p, "a.toml", AXIS + 'driver = "x"')],
        "no driver 'x' is installed; there are",
    ),
    "unknown effect": (
        lambda p: [
            "check-config",
            write(
                p,
                "a.toml",
                AXIS + f'machine = "{write(p, "m.toml", MACHINE + EFFECT)}"',
            ),
        ],
        "m.toml: effects: ",
    ),
    "output over its own input": (
        lambda p: ["estimate", write(p, "t.csv", TRACE), "--out", str(p / "t.csv")],
        "would overwrite its own input",
    ),
    "no axes": (lambda p: ["check-config", write(p, "a.toml", "axes = []")], "axes:"),
    "public http address": (
        lambda p: ["check-config", write(p, "a.toml", AXIS + '[http]\nhost = "0.0.0.0"')],
        "http: '0.0.0.0' is not a loopback address: it needs certificate and private_key",
    ),
    "a certificate without its key": (
        lambda p: ["run", write(p, "a.toml", AXIS + '[http]\ncertificate = "c"')],
        "http: private_key: missing; certificate and private_key are needed together",
    ),
    "a certificate that is none": (
        lambda p: [
            "run",
            private(p, "a.toml", AXIS + '[http]\ncertificate = "a.toml"\nprivate_key = "a.toml"'),
        ],
        "not in PEM format, or the key has a password",
    ),
    "a key that others may read": (
        lambda p: [
            "run",
            write(p, "a.toml", AXIS + '[http]\ncertificate = "a.toml"\nprivate_key = "a.toml"'),
        ],
        "http.private_key: ",
    ),
    "tokens without a state folder": (
        lambda p: ["token", write(p, "a.toml", AXIS)],
        "store.folder: missing; tokens are kept in the state folder",
    ),
    "a token without a role": (
        lambda p: ["token", write(p, "a.toml", KEPT), "--add", "kim"],
        "expected --add NAME --role viewer|operator, or --revoke NAME",
    ),
    "a proxy without tokens": (
        lambda p: ["check-config", write(p, "a.toml", KEPT + '[http]\nurl = "https://mill"')],
        "http.url: beyond loopback a token is needed: edge-service token",
    ),
    "public bus address": (
        lambda p: ["run", "--bus", "tcp/0.0.0.0:7447", write(p, "a.toml", AXIS)],
        "tcp is for loopback addresses; state others in bus.zenoh_file",
    ),
    "a file of Zenoh that is not there": (
        lambda p: ["run", write(p, "a.toml", AXIS + '[bus]\nzenoh_file = "z.json5"')],
        "z.json5: No such file or directory",
    ),
    "wrong unit": (
        lambda p: [
            "check-config",
            write(p, "a.toml", AXIS + f'machine = "{write(p, "m.toml", MACHINE_IN_MM)}"'),
        ],
        "axis.lead_m:",
    ),
    "missing trace": (
        lambda p: ["estimate", str(p / "no.csv"), "--out", str(p / "out.csv")],
        "no such file",
    ),
    "mapped column that is missing": (
        lambda p: [
            "estimate",
            write(p, "t.csv", "t_s,q\n1,2\n"),
            "--machine",
            write(p, "m.toml", MACHINE + '[columns]\ntime_s = "t_s"\nmotor_angle_rad = "theta"'),
            "--out",
            str(p / "out.csv"),
        ],
        "theta",
    ),
    "replay of a missing trace": (
        lambda p: ["replay", str(p / "no.csv"), "--port", "0"],
        "no such file",
    ),
    "record without a service": (
        lambda p: ["record", "--bus", "tcp/127.0.0.1:1", "--out", str(p / "out.csv")],
        "no bus answers",
    ),
    "unknown command": (
        lambda _: ["fingerprnt"],
        "no command 'fingerprnt'; did you mean 'fingerprint'?",
    ),
    "missing option": (lambda p: ["estimate", write(p, "t.csv", TRACE)], "--out"),
}
MACHINE = "[axis]\nlead_m = 0.02\n[model]\ninertia_kg_m2 = 1e-3\n"
EFFECT = '[[effects]]\nname = "nosuch"\n'
MACHINE_IN_MM = "[axis]\nlead_m = 20.0\n[model]\ninertia_kg_m2 = 1e-3\n"


@pytest.mark.parametrize("name", CASES)
def test_a_mistake_is_one_line_and_status_2(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, expected = CASES[name]
    arguments = make(tmp_path)
    status = main(arguments)
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert status == 2
    complaint = next((line for line in lines if expected in line), lines[-1])
    assert complaint.startswith("edge-service: ")
    assert expected in complaint
    assert "Traceback" not in captured.err
    assert arguments[0] != "check-config" or re.search(r"\.toml: ", complaint)
    assert not (tmp_path / "out.csv").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_port_in_use_is_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        status = main(["run", "--port", str(port), "--bus", "tcp/127.0.0.1:0"])
        assert status == 2
        said = capsys.readouterr().err
        assert f"127.0.0.1:{port} is in use" in said
        assert "--port" in said
        assert main(["run", "--port", "0", "--bus", f"tcp/127.0.0.1:{port}"]) == 2
        said = capsys.readouterr().err
        assert f"tcp/127.0.0.1:{port} is in use" in said
        assert "--bus" in said


def test_an_estimate_file_has_the_columns_of_the_contract(tmp_path: Path) -> None:
    rows = "".join(f"{i / 1000},0.1,{i / 10}\n" for i in range(500))
    trace = write(tmp_path, "t.csv", "time_s,torque_command_nm,motor_angle_rad\n" + rows)
    out = tmp_path / "out.csv"
    assert main(["estimate", trace, "--out", str(out)]) == 0
    header, *body = out.read_text().splitlines()
    assert header == "time_s,preload_percent,low,high,status,drag_torque_nm,reasons"
    assert [line.split(",")[0] for line in body] == ["0.1", "0.2", "0.3", "0.4"]
    assert {line.split(",")[-1] for line in body} == {"no_motion torque_stuck"}


def test_check_config_says_what_the_default_means(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-config"]) == 0
    printed = capsys.readouterr().out
    assert "axis X: driver simulated" in printed
    assert "preload in %" in printed


ROOMS_NEED = ("numpy", "zenoh", "fastapi", "numba", "scipy", "matplotlib", "pyarrow", "filterpy")


def answered(arguments: list[str]) -> str:
    """Exit status of a fresh interpreter's command, and the heavy libraries it has loaded."""
    script = (
        f"import sys; from edge_service.cli.entry import main; status = main({arguments});"
        f"print(status, *sorted({{'pydantic', *{ROOMS_NEED}}} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["diagnose", "--help"]])
def test_the_command_starts_without_what_it_does_not_need(arguments: list[str]) -> None:
    assert answered(arguments) == f"{DONE}"


@pytest.mark.parametrize(
    "arguments",
    [["diagnose", "--unknown"], ["token", "x.toml", "--add", "kim", "--revoke", "kim"]],
)
def test_a_mistake_is_told_before_anything_is_loaded(arguments: list[str]) -> None:
    assert answered(arguments) == f"{BAD_INPUT}"


@pytest.mark.parametrize(("stated", "alone"), [({}, True), ({"OPENBLAS_NUM_THREADS": "2"}, False)])
def test_linear_algebra_keeps_to_one_thread_unless_asked(
    stated: dict[str, str], alone: bool
) -> None:
    """The number must be set before numpy is loaded."""
    if not alone and (os.cpu_count() or 1) == 1:
        pytest.skip("one core has one thread")
    script = (
        "import edge_service.cli.entry, os; import numpy as np; a = np.ones((400, 400)); a @ a;"
        "print(len(os.listdir('/proc/self/task')))"
    )
    kept = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        env=kept | stated,
    )
    assert (int(done.stdout) == 1) is alone


def test_benchmarks_need_a_checkout(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"^bench: it needs a checkout of the project[^\n]*$"):
        benchmarks(tmp_path)
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "another"\n')
    with pytest.raises(BadInputError, match=r"^bench: it needs a checkout"):
        benchmarks(tmp_path)


def test_benchmarks_of_the_checkout_are_found_from_any_folder(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "edge_service", "bench", "speed", "--only", "nothing", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    said = "--only nothing: no part of speed; there are paced"
    assert said in done.stderr
    assert json.loads(done.stdout)["error"]["detail"].startswith(said)
