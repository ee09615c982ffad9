"""The speed table: aims are of ratios, children are counted, and the peer really works."""

import math
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.bench.commands import bench

from ..table import Figure, Table, figures_table
from .paced import MOSQUITTO, _peer
from .process_meter import Program, _text, _tree, usage_of


def test_an_aim_is_one_of_the_ratio_where_there_is_a_peer() -> None:
    assert Figure("n", 10.0, "us", 120.0, "peer", at_least=12.0).met is True
    assert Figure("n", 11.0, "us", 120.0, "peer", at_least=12.0).met is False
    assert Figure("n", 0.2, "s").met is None
    missed = str(figures_table([Figure("help", 0.4, "s", at_most=0.3)], ["a note"]))
    assert "NO" in missed
    assert "a note" in missed


def test_a_program_gets_numbers() -> None:
    (told,) = figures_table([Figure("help", 0.4, "s", at_most=0.3)]).document()["figures"]
    assert (told["name"], told["value"], told["met"]) == ("help", 0.4, False)
    table = Table(("a", "b"), ((math.nan, 1.5), ("x", None)))
    assert table.document()["rows"] == [[None, 1.5], ["x", None]]


def test_children_are_counted_with_their_parent() -> None:
    """By far more than what this process, which other tests share, gains and loses meanwhile."""
    before = usage_of(os.getpid())
    code = (
        "import time\nheld = b'x' * 200_000_000\nwhile time.process_time() < 0.3: pass\n"
        "print(1, flush=True)\ninput()"
    )
    with Program(sys.executable, "-c", code) as child:
        child.hear()
        after = usage_of(os.getpid())
    assert after.cpu_s - before.cpu_s >= 0.25
    assert after.shared_mb > before.shared_mb + 100.0


@pytest.mark.slow
def test_what_it_started_ends_with_it() -> None:
    line = (sys.executable, "-m", "edge_service", "bench", "speed", "--quick", "--only", "start")
    with Program(*line) as run:
        while not (started := _tree(run.pid)[1:]):
            time.sleep(0.1)
        os.kill(run.pid, signal.SIGTERM)
        assert not run.hear()
    while any("edge_service" in _text(Path(f"/proc/{each}/cmdline")) for each in started):
        time.sleep(0.1)


@pytest.mark.slow
@pytest.mark.skipif(MOSQUITTO is None, reason="mosquitto is not installed")
def test_the_peer_estimates_from_every_sample_that_it_gets(tmp_path: Path) -> None:
    with _peer(tmp_path, 2) as peer:
        before = peer.look()
        while (after := peer.look())[1] - before[1] < 500:
            pass
    assert after[0] > before[0]


@pytest.mark.slow
@pytest.mark.smoke
def test_the_command_prints_a_table() -> None:
    line = ["speed", "--quick", "--only", "estimator"]
    printed = CliRunner().invoke(bench, line, catch_exceptions=False).stdout
    assert "mixture estimator: each interval" in printed
