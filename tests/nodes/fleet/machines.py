"""Machines of a plant in a process of their own: reports, and a log of their own.

    python -m tests.nodes.fleet.machines tcp/127.0.0.1:7450 --machines 10 --axes 8 --period 0.1

Prints a line once all have reported, and at its end how many reports it has sent.
"""

import argparse
import asyncio
import json
import signal
import sys
import time
from collections.abc import Callable
from typing import Any

from edge_service.bus.plant.reporting import Reporting
from edge_service.bus.plant.session import PlantAwayError, PlantSession, PlantSettings
from edge_service.messages.advice import Headline, Level
from edge_service.messages.estimate import EstimateStatus, Interval
from edge_service.messages.health import AxisCondition
from edge_service.messages.plant import (
    AxisReport,
    LogAnswer,
    LoggedReport,
    LogQuestion,
    LogState,
    MachineReport,
    PlantKeys,
)

NAMES = "XYZABCUVW"


def axis_report(name: str, share: float, loss: float, now_ns: int) -> AxisReport:
    """An axis at a share of its fresh preload of 10 %, losing `loss` % of it in 1000 h."""
    condition = AxisCondition.NORMAL
    if share < 60.0:
        condition = AxisCondition.FAULT if share < 30.0 else AxisCondition.WARNING
    worn = condition is not AxisCondition.NORMAL
    level = {"NORMAL": Level.OK, "WARNING": Level.ATTENTION, "FAULT": Level.ACT}[condition]
    text = f"preload is at {share:.0f} % of fresh"
    day_ns = 86_400_000_000_000
    return AxisReport(
        axis=name,
        condition=condition,
        headline=Headline(level=level, code=condition.lower(), text=text),
        task="plan a new nut" if worn else "",
        status=EstimateStatus.ESTIMATED,
        time_ns=now_ns - 150_000_000,
        preload_percent=share / 10.0,
        low=share / 10.0 - 0.2,
        high=share / 10.0 + 0.2,
        fresh_percent=10.0,
        fits=True,
        limit="fault" if worn else "warning",
        limit_earliest_ns=now_ns + 20 * day_ns,
        limit_likely_ns=now_ns + 30 * day_ns,
        limit_latest_ns=now_ns + 50 * day_ns,
        loss_per_1000_h=Interval(value=loss, low=loss - 1.0, high=loss + 1.0),
        reason=f"preload below {60 if share >= 30.0 else 30} % of fresh" if worn else "",
    )


class SimulatedMachine:
    """One machine; the first one's first axis wears out.

    Args:
        log: name of its log; empty for none.
        logged: reports in it at the start.
    """

    def __init__(
        self,
        session: PlantSession,
        site: str,
        machine: str,
        axes: int,
        period_s: float,
        log: str,
        logged: int,
        worn: bool,
    ) -> None:
        self.keys = PlantKeys(site, machine)
        self._axes, self._period_s, self._log, self.worn = axes, period_s, log, worn
        self.first, self.last = 1, logged
        self._seed = sum(map(ord, machine))
        self.sent = 0
        """Reports so far."""
        self._reporting = Reporting(session, self.keys, axes, period_s, self._answer)

    def report(self, now_ns: int, with_log: bool = True) -> MachineReport:
        """The report of a moment."""
        axes = []
        for k in range(self._axes):
            wears = self.worn and k == 0
            loss = 60.0 if wears else 8.0 + ((self._seed + 7 * k) % 40) / 10.0
            if k == 3:
                loss = 0.5  # which may be none
            share = 25.0 if wears else 85.0 + (self._seed + k) % 15
            axes.append(
                axis_report(NAMES[k % 9] + (str(k // 9) if k > 8 else ""), share, loss, now_ns)
            )
        log = LogState(log=self._log, first=self.first, last=self.last) if self._log else None
        return MachineReport(
            site=self.keys.site,
            machine=self.keys.machine,
            time_ns=now_ns,
            period_s=self._period_s,
            version="0.1.0",
            page="http://127.0.0.1:8080",
            log=log if with_log else None,
            axes=tuple(axes),
        )

    def publish(self) -> None:
        """Put the next report."""
        self._reporting.publish(self.report(time.time_ns()))
        self.sent += 1

    def _answer(self, _key: str, question: bytes, reply: Callable[[bytes | None], None]) -> None:
        asked = LogQuestion.model_validate_json(question)
        first = max(asked.after + 1, self.first) if asked.log == self._log else self.first
        numbers = range(first, min(first + asked.most, self.last + 1))
        start_ns = 1_790_000_000_000_000_000
        reports = tuple(
            LoggedReport(number=n, report=self.report(start_ns + n * 600_000_000_000, False))
            for n in numbers
        )
        reply(LogAnswer(log=self._log, reports=reports).model_dump_json().encode())


def say(line: str) -> None:
    """Tell whoever has started this process."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


async def _opened(endpoint: str) -> PlantSession:
    while True:
        try:
            return await PlantSession.open(PlantSettings(endpoint))
        except PlantAwayError:
            await asyncio.sleep(0.2)


async def run(given: Any) -> None:
    """Report until SIGTERM; a number on stdin makes all logs that much longer."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    session = await _opened(given.endpoint)
    machines = [
        SimulatedMachine(
            session,
            f"{given.site}{k % given.sites}",
            f"{given.prefix}{k:04d}",
            given.axes,
            given.period,
            given.log,
            given.logged,
            k == 0,
        )
        for k in range(given.machines)
    ]
    rounds, began_s = 0, loop.time()
    ended = None if given.rounds == 0 else given.rounds
    while not stop.is_set() and rounds != ended:
        for k, machine in enumerate(machines):
            machine.publish()
            if k % 50 == 49:
                await asyncio.sleep(0)
        rounds += 1
        if rounds == 1:
            say("reporting")
        left_s = began_s + rounds * given.period - loop.time()
        try:
            async with asyncio.timeout(max(left_s, 0.0)):
                await stop.wait()
        except TimeoutError:
            pass
    if not stop.is_set():
        say("done")
        await stop.wait()
    say(json.dumps({"sent": sum(each.sent for each in machines)}))
    await session.close()


def main() -> None:
    """Read the arguments and run."""
    parser = argparse.ArgumentParser()
    parser.add_argument("endpoint")
    parser.add_argument("--machines", type=int, default=1)
    parser.add_argument("--axes", type=int, default=8)
    parser.add_argument("--period", type=float, default=1.0)
    parser.add_argument("--prefix", default="m")
    parser.add_argument("--site", default="hall")
    parser.add_argument("--sites", type=int, default=2)
    parser.add_argument("--log", default="")
    parser.add_argument("--logged", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=0)
    asyncio.run(run(parser.parse_args()))


if __name__ == "__main__":
    sys.exit(main())
