"""The speed table: aims are of ratios, trees are counted whole, and the peer really works."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.bench.commands import bench

from .bench import Speed, SpeedTable, _exponent, less
from .paced import MOSQUITTO, _peer
from .parts import history_us, recorder_us
from .tree import usage_of


def test_an_aim_is_one_of_the_ratio_where_there_is_a_peer() -> None:
    assert less("k", "n", 10.0, 120.0, "us", "peer", at_least=12.0).met is True
    assert less("k", "n", 11.0, 120.0, "us", "peer", at_least=12.0).met is False
    assert Speed("k", "n", 0.4, "s", at_most=0.3).met is False
    assert Speed("k", "n", 0.2, "s", at_most=0.3).met is True
    assert Speed("k", "n", 0.2, "s").met is None


def test_a_missed_aim_is_told_in_words_and_in_json() -> None:
    table = SpeedTable((Speed("help_s", "help", 0.4, "s", at_most=0.3),), ("a note",))
    assert "NO" in table.as_text()
    assert "a note" in table.as_text()
    (figure,) = json.loads(json.dumps(table.as_dict()))["figures"]
    assert figure["met"] is False


def test_an_exponent_is_that_of_the_growth() -> None:
    assert _exponent((1, 4, 16), [3.0, 24.0, 192.0]) == pytest.approx(1.5)


def test_children_are_counted_with_their_parent() -> None:
    """By far more than what this process, which other tests share, gains and loses meanwhile."""
    before = usage_of(os.getpid())
    code = (
        "import time\nheld = b'x' * 200_000_000\nwhile time.process_time() < 0.3: pass\n"
        "print(1, flush=True)\ninput()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        after = usage_of(os.getpid())
        child.kill()
    assert after.cpu_s - before.cpu_s >= 0.25
    assert after.shared_mb > before.shared_mb + 100.0


def test_the_recorder_is_compared_with_something_that_writes_as_much() -> None:
    ours, theirs = recorder_us(2000, 1)
    assert ours > 0.0
    assert theirs > 0.0


def test_a_year_of_history_is_all_there() -> None:
    ours, theirs = history_us(1)
    assert min(ours, theirs) > 0.0


@pytest.mark.skipif(MOSQUITTO is None, reason="mosquitto is not installed")
def test_the_peer_estimates_from_every_sample_that_it_gets(tmp_path: Path) -> None:
    with _peer(tmp_path, 2) as peer:
        before, until_s = peer.look(), time.monotonic() + 20.0
        while (after := peer.look())[1] - before[1] < 500 and time.monotonic() < until_s:
            pass
    assert after[1] - before[1] >= 500
    assert after[0] > before[0]


@pytest.mark.slow
def test_the_command_prints_a_table_or_json() -> None:
    line = ["speed", "--quick", "--only", "recorder", "--only", "plant"]
    printed = CliRunner().invoke(bench, [*line, "--json"], catch_exceptions=False)
    keys = [figure["key"] for figure in json.loads(printed.stdout)["figures"]]
    assert keys == ["plant_plain_s", "plant_effects_s", "recorder_us"]
