"""The log's rate: no place of the program can fill a disk, and none silences another."""

import logging

from edge_service.cli.terminal import LogRate


def _record(line: int, text: str = "lost %d", number: int = 1) -> logging.LogRecord:
    return logging.LogRecord("edge", logging.WARNING, "place.py", line, text, (number,), None)


def test_a_place_that_never_stops_is_held_to_its_rate():
    now_s = [0.0]
    rate = LogRate(burst=3, per_s=0.5, clock=lambda: now_s[0])
    assert sum(rate.filter(_record(1, number=n)) for n in range(10_000)) == 3
    now_s[0] = 2.0
    late = _record(1, number=7)
    assert rate.filter(late)
    assert late.getMessage() == "lost 7 (and 9997 times more)"
    assert not rate.filter(_record(1))


def test_one_place_does_not_silence_another():
    rate = LogRate(burst=1, clock=lambda: 0.0)
    assert rate.filter(_record(1))
    assert not rate.filter(_record(1, "other words %d"))
    assert rate.filter(_record(2))
