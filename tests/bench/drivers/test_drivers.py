"""The bench of the drivers measures what it says."""

import pytest

from .bench import run_drivers_bench


@pytest.mark.slow
def test_the_whole_bench_runs_and_a_hanging_device_is_lost_and_found() -> None:
    lines: list[str] = []
    table = run_drivers_bench(True, lines.append)
    assert len(lines) == 3
    value = {row[0]: float(row[1].replace(",", "")) for row in table.rows}
    assert value["32 devices at 10 Hz: polls"] == pytest.approx(320.0, rel=0.1)
    assert value["  the hanging device is called lost after"] < 3.0
    assert value["  it is back after it answers again"] < 7.0
    assert value["OPC UA, 8 sessions at 100 ms: notifications"] > 100.0
