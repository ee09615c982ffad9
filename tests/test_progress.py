"""Progress of a command: one line at a terminal, one every ten seconds into a pipe."""

import io

import click
import pytest

from edge_service.cli.options import command
from edge_service.cli.terminal import ProgressLine, pause_progress, progress
from edge_service.command_answer import Answer
from edge_service.exit_status import DONE

CLEARED = "\r\x1b[2K"


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
    monkeypatch.delenv("EDGE_SERVICE_PROGRESS", raising=False)
    seen = shown(Terminal(), monkeypatch)
    assert f"{CLEARED}reading [1] a.csv, 90 %, 0 s, 0 s left" in seen
    assert "\n" not in seen
    assert seen.endswith(CLEARED)


def test_a_person_sees_something_before_the_command_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("EDGE_SERVICE_PROGRESS", raising=False)
    monkeypatch.setattr("sys.stderr", stderr := Terminal())

    def looking() -> Answer:
        assert stderr.getvalue() == f"{CLEARED}loading, 0 s"
        return Answer("done", {})

    assert command("looking")(looking).main([], standalone_mode=False) == DONE


def test_a_pipe_stays_quiet_at_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("EDGE_SERVICE_PROGRESS", raising=False)
    assert shown(io.StringIO(), monkeypatch) == ""


@pytest.mark.parametrize("stderr", [io.StringIO(), Terminal()])
def test_time_is_told_and_what_is_left(
    stderr: io.StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stderr", stderr)
    monkeypatch.delenv("EDGE_SERVICE_PROGRESS", raising=False)
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
