"""The command line: a mistake is one clear line, progress is shown, help is as the table says."""

import io
import json
import os
import re
import socket
import sys
import tomllib
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from edge_service.cli.entry import GROUPS, cli, main, summary
from edge_service.cli.options import command
from edge_service.cli.terminal import ProgressLine, pause_progress, progress
from edge_service.cli.twin import benchmarks
from edge_service.command_answer import Answer
from edge_service.exit_status import BAD_INPUT, DONE, BadInputError
from edge_service.health.store.store import held
from tests.programs import printed, ran

from .bench.commands import bench
from .documents import document
from .test_cli_drivers import modbus

COMMANDS = sorted(cli.commands)
CLEARED = "\r\x1b[2K"
ROW = re.compile(
    r"^\| (?:\*\*(.+)\*\*|`edge-service ([a-z-]+) ?(.*?)`) \| (.*?) ?\| (?:`(.*)` )?\|$"
)
SHARED = ("--help", "--json")
MOST_OPTIONS, MOST_COMMANDS, MOST_CHARACTERS = 80, 26, 70


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_helps_with_an_example(command: str) -> None:
    result = CliRunner().invoke(cli, [command, "--help"])
    assert result.exit_code == 0
    assert "Example: edge-service" in " ".join(result.output.split())


def write(folder: Path, name: str, text: str) -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


MACHINE = "[axis]\nlead_m = 0.02\n[model]\ninertia_kg_m2 = 1e-3\n"
FILES = {
    "t.csv": "time_s,torque_command_nm,motor_angle_rad\n0,1,2\n0.001,1,2\n",
    "stands.csv": "time_s,torque_command_nm,motor_angle_rad\n1,1,2\n1,2,3\n",
    "foreign.csv": "t_s,q\n1,2\n",
    "columns.toml": MACHINE + '[columns]\ntime_s = "t_s"\nmotor_angle_rad = "theta"',
    "effect.toml": MACHINE + '[[effects]]\nname = "nosuch"\n',
    "mm.toml": MACHINE.replace("0.02", "20.0"),
    "no.toml": "x = = 1",
    "digits.toml": f"x = {'9' * 5000}",
    "bom.toml": "\ufeff" + modbus(more=', unit = "kW"'),
    "edge.toml": modbus(),
    "unit.toml": modbus(more=', unit = "mm"'),
}
Capture, Patch = pytest.CaptureFixture[str], pytest.MonkeyPatch
AXIS = '[[axes]]\nname = "X"\n'
MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))


def complaint(words: str, capsys: Capture) -> str:
    """Complaint of a call, of the files in the present folder."""
    for name, text in FILES.items():
        Path(name).write_text(text)
    Path("loop.csv").symlink_to("loop.csv")
    assert main(words.split()) == 2
    told = capsys.readouterr().err
    assert "Traceback" not in told
    assert not Path("out.csv").exists()
    assert not list(Path().glob(".*"))
    return told


@pytest.mark.parametrize(
    ("words", "text", "expected"),
    [*((words, None, said) for words, said in MISTAKES["calls"]), *MISTAKES["configurations"]],
)
def test_a_mistake_is_one_line_with_its_place_and_status_2(
    words: str, text: str | None, expected: str, tmp_path: Path, capsys: Capture, monkeypatch: Patch
) -> None:
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path("a.toml").touch(0o600)
        Path("a.toml").write_text(text if "axes" in text else f"{text}\n{AXIS}")
        words = f"{words} a.toml"
    (line,) = [line for line in complaint(words, capsys).splitlines() if expected in line]
    assert line.startswith("edge-service: ")
    assert ".toml: " in line or not words.startswith("check-config a")


def test_a_port_in_use_is_one_line_and_status_2(tmp_path: Path, capsys: Capture) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        place = f"tcp/127.0.0.1:{port}"
        for call, told, option in (
            (f"run --port {port} --bus tcp/127.0.0.1:0", f"127.0.0.1:{port} is in use", "--port"),
            (f"run --port 0 --bus {place}", f"{place} is in use", "--bus"),
            ("stub modbus " + write(tmp_path, "edge.toml", modbus(port)), "is in use", "--port"),
        ):
            assert main(call.split()) == 2
            said = capsys.readouterr().err
            assert told in said
            assert option in said


def test_an_estimate_file_has_the_columns_of_the_contract(tmp_path: Path, capsys: Capture) -> None:
    rows = "".join(f"{i / 1000},0.1,{i / 10}\n" for i in range(500))
    trace = write(tmp_path, "t.csv", "time_s,torque_command_nm,motor_angle_rad\n" + rows)
    out = tmp_path / "out.csv"
    assert main(["estimate", trace, "--out", str(out)]) == 0
    header, *body = out.read_text().splitlines()
    assert header == "time_s,preload_percent,low,high,status,drag_torque_nm,reasons,method"
    assert [line.split(",")[0] for line in body] == ["0.1", "0.2", "0.3", "0.4"]
    assert {tuple(line.split(",")[-2:]) for line in body} == {("no_motion torque_stuck", "kf-imm")}
    assert main(["estimate", trace, "--out", f"{out}/o.csv"]) == 2
    assert f"{out}: cannot be used (File exists)" in capsys.readouterr().err


def test_a_folder_of_another_service_is_refused(tmp_path: Path, capsys: Capture) -> None:
    config = write(tmp_path, "edge.toml", "[http]\nport = 0\n[store]\nfolder = 'state'\n" + AXIS)
    with held(tmp_path / "state"):
        assert main(["run", config, "--bus", "tcp/127.0.0.1:0"]) == 2
    assert f"{tmp_path}/state: another service runs on it" in capsys.readouterr().err


def test_who_revokes_the_last_token_reads_who_is_let_in(tmp_path: Path, capsys: Capture) -> None:
    config = write(tmp_path, "edge.toml", "[store]\nfolder = 's'\n" + AXIS)
    for change in ("--add kim --role viewer", "--revoke kim"):
        assert main(["token", config, *change.split()]) == 0
    assert capsys.readouterr().out.endswith("no tokens: any local user may do everything\n")


def test_check_config_says_what_the_default_means(capsys: Capture) -> None:
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
    return printed(sys.executable, "-c", script).splitlines()[-1]


LIGHT = dict.fromkeys(("--help", "--version", "diagnose --help"), DONE)
LIGHT |= dict.fromkeys(("diagnose --unknown", "token x.toml --add kim --revoke kim"), BAD_INPUT)


@pytest.mark.parametrize("words", LIGHT)
def test_help_and_mistakes_come_before_anything_is_loaded(words: str) -> None:
    assert answered(words.split()) == f"{LIGHT[words]}"


@pytest.mark.parametrize(("stated", "alone"), [({}, True), ({"OPENBLAS_NUM_THREADS": "2"}, False)])
def test_linear_algebra_keeps_to_one_thread_by_default(stated: dict[str, str], alone: bool) -> None:
    """The number must be set before numpy is loaded."""
    if not alone and (os.cpu_count() or 1) == 1:
        pytest.skip("one core has one thread")
    script = (
        "import edge_service.cli.entry, os; import numpy as np; a = np.ones((400, 400)); a @ a;"
        "print(len(os.listdir('/proc/self/task')))"
    )
    kept = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    said = printed(sys.executable, "-c", script, variables=kept | stated)
    assert (int(said) == 1) is alone


def test_benchmarks_need_a_checkout(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"^bench: it needs a checkout of the project[^\n]*$"):
        benchmarks(tmp_path)
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "another"\n')
    with pytest.raises(BadInputError, match=r"^bench: it needs a checkout"):
        benchmarks(tmp_path)


def test_benchmarks_of_the_checkout_are_found_from_any_folder(tmp_path: Path) -> None:
    line = ("-m", "edge_service", "bench", "speed", "--only", "nothing", "--json")
    done = ran(sys.executable, *line, folder=tmp_path)
    assert done.returncode == 2
    said = "--only nothing: no part of speed; there are paced"
    assert said in done.stderr
    assert json.loads(done.stdout)["error"]["detail"].startswith(said)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@click.command()
def working() -> None:
    """Work for two steps, with an answer between them."""
    progress("reading [1] a.csv: 10 %")
    pause_progress()
    click.echo("answer")
    progress("reading [1] a.csv: 90 %")


def shown(stderr: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr("sys.stderr", stderr)
    working.main([], prog_name="working", standalone_mode=False)
    return stderr.getvalue()


def test_a_person_sees_one_line_that_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = shown(Terminal(), monkeypatch)
    assert f"{CLEARED}reading [1] a.csv, 90 %, 0 s, 0 s left" in seen
    assert "\n" not in seen
    assert seen.endswith(CLEARED)


def test_a_person_sees_something_before_the_command_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", stderr := Terminal())

    def looking() -> Answer:
        assert stderr.getvalue() == f"{CLEARED}loading, 0 s"
        return Answer("done", {})

    assert command("looking")(looking).main([], standalone_mode=False) == DONE


def test_a_pipe_stays_quiet_at_first(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(io.StringIO(), monkeypatch) == ""


@pytest.mark.parametrize("stderr", [io.StringIO(), Terminal()])
def test_time_is_told_and_the_rest(stderr: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", stderr)
    times = iter((0.0, 12.0, *[32.0] * 9))
    line = ProgressLine("diagnose", clock=lambda: next(times))
    line.tell("choosing causes: 40 %")
    line.draw()
    line.pause()
    seen = stderr.getvalue().removesuffix(CLEARED)
    if stderr.isatty():
        assert seen.endswith(f"{CLEARED}choosing causes, 40 %, 32 s, 30 s left")
    else:
        assert seen == "edge-service diagnose: choosing causes, 40 %, 32 s\n"


def test_a_service_that_asks_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EDGE_SERVICE_PROGRESS", "1")
    lines = shown(io.StringIO(), monkeypatch).splitlines()
    said = "edge-service working: reading [1] a.csv"
    assert lines == [f"{said}, 10 %, 0 s", f"{said}, 90 %, 0 s"]


def table() -> dict[str, list[tuple[str, str, str, set[str]]]]:
    """Group -> command, arguments, summary and options of each row."""
    groups: dict[str, list[tuple[str, str, str, set[str]]]] = {}
    for line in document("edge_service/cli/README.md").splitlines():
        if (found := ROW.match(line)) is None:
            continue
        title, name, arguments, words, options = found.groups()
        if title:
            groups[title] = []
        elif groups:
            row = name, arguments, words, set((options or "").split())
            list(groups.values())[-1].append(row)
    return groups


def options_of(command: click.Command) -> set[str]:
    options = (each for each in command.params if isinstance(each, click.Option))
    return {name for each in options for name in each.opts if name.startswith("--")}


ROWS = [row for rows in table().values() for row in rows]


def test_groups_and_commands_are_those_of_the_table() -> None:
    shown = {title: [row[0] for row in rows] for title, rows in table().items()}
    assert shown == {title: [each.name for each in group] for title, group in GROUPS.items()}
    hidden = {name for name, each in cli.commands.items() if each.hidden}
    assert hidden == {"help", "version", "drift"}
    assert {row[0] for row in ROWS} | hidden == set(cli.commands)
    assert len(ROWS) <= MOST_COMMANDS


@pytest.mark.parametrize(("name", "arguments", "words", "options"), ROWS, ids=lambda row: row)
def test_help_says_what_the_table_says(
    name: str, arguments: str, words: str, options: set[str]
) -> None:
    command = cli.commands[name]
    assert summary(command) == words
    assert len(words) <= MOST_CHARACTERS
    if command.name == "bench":
        assert options <= options_of(bench)
        return
    context = click.Context(command, info_name=name)
    told = command.collect_usage_pieces(context)
    assert " ".join(told).removeprefix("[OPTIONS]").strip() == arguments
    assert options_of(command) - set(SHARED) == options


def test_options_are_few() -> None:
    defined = {
        (option, each.help)
        for command in cli.commands.values()
        for each in command.params
        if isinstance(each, click.Option)
        for option in each.opts
    }
    assert len(defined) <= MOST_OPTIONS


def test_the_list_has_whole_summaries() -> None:
    said = CliRunner().invoke(cli, ["--help"]).output
    for title, rows in table().items():
        assert f"\n{title}:\n" in said
        for name, _, words, _ in rows:
            assert f"  {name:<16}{words}\n" in said
    assert said.endswith("`edge-service help COMMAND` shows options and an example.\n")


def test_help_and_version_work() -> None:
    said = CliRunner().invoke(cli, ["help", "estimate"]).output
    assert said == CliRunner().invoke(cli, ["estimate", "--help"]).output
    assert CliRunner().invoke(cli, ["help"]).output == CliRunner().invoke(cli, ["--help"]).output
    assert CliRunner().invoke(cli, ["version"]).output.startswith("edge-service, version ")
