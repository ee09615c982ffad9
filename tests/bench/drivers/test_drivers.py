"""The bench of the drivers measures what it says."""

import asyncio

import pytest

from .bench import DriversBenchSettings, run_drivers_bench
from .modbus import make_driver, poll_figures, responders


def test_polls_are_counted_beside_a_bare_client() -> None:
    values = {figure.key: figure.value for figure in poll_figures(0.3)}
    assert min(values["modbus_bare_polls_per_s"], values["modbus_polls_per_s"]) > 0.0
    assert min(values["modbus_cpu_s"], values["modbus_bare_cpu_s"]) > 0.0
    assert values["modbus_cpu_over_bare"] == pytest.approx(
        values["modbus_cpu_s"] / values["modbus_bare_cpu_s"]
    )


async def test_a_device_of_the_bench_hangs_and_answers_on_command() -> None:
    with responders(2) as devices:
        driver = make_driver(devices.ports[1], 0.01)
        await driver.open()
        frames = driver.frames()
        await anext(frames)
        devices.tell("hang", 1)
        async with asyncio.timeout(10.0):
            while driver.counters.get("bad_no_reply", 0) == 0:
                await anext(frames)
        devices.tell("answer", 1)
        await frames.aclose()
        await driver.close()
        async with asyncio.timeout(10.0):
            await driver.open()
        await driver.close()


@pytest.mark.slow
def test_the_whole_bench_runs_and_a_hanging_device_is_lost_and_found() -> None:
    lines: list[str] = []
    bench = run_drivers_bench(DriversBenchSettings(quick=True), lines.append)
    assert len(lines) == 3
    assert bench.value("fleet_polls_per_s") == pytest.approx(320.0, rel=0.1)
    assert bench.value("fleet_lost_after_s") < 3.0
    assert bench.value("fleet_back_after_s") < 7.0
    assert bench.value("opcua_notifications_per_s") > 100.0
    assert "modbus" in bench.as_text().lower()
