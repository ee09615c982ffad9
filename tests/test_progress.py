"""A line on what is being done: one at a terminal, plain ones if asked for, none in a pipe."""

import io

import click
import pytest

from edge_service.cli.terminal import pause_progress, progress

CLEARED = "\x1b[2K"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        """A person sits here."""
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
    monkeypatch.setenv("TERM", "xterm")
    working.main([], standalone_mode=False)
    return stderr.getvalue()


def test_a_person_sees_one_line_that_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = shown(Terminal(), monkeypatch)
    assert "reading [1] a.csv: 90 %" in seen
    assert seen.rstrip().endswith(CLEARED)


def test_a_pipe_stays_quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("EDGE_SERVICE_PROGRESS", raising=False)
    assert shown(io.StringIO(), monkeypatch) == ""


def test_a_service_that_asks_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EDGE_SERVICE_PROGRESS", "1")
    lines = shown(io.StringIO(), monkeypatch).splitlines()
    assert lines == ["reading [1] a.csv: 10 %", "reading [1] a.csv: 90 %"]
