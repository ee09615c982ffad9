"""One output as a node: hands it what holds now of every axis."""

import asyncio
import logging
from collections.abc import Coroutine
from functools import partial
from typing import Any

from ..config import ConfigError, EdgeConfig, check_settings
from ..messages.health import ComponentStatus
from ..outputs.base import (
    Message,
    Output,
    OutputContext,
    OutputMisconfiguredError,
    OutputUnavailableError,
    UnknownOutputError,
    load_output,
)
from ..retry import Retry
from .outputs.latest_answers import LatestAnswers
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter
from .wiring.http_rights import knows_of

SHOW_PERIOD_S = 0.5
TAKE_S = 10.0
"""Longest time in which an output takes a message."""
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0
log = logging.getLogger(__name__)


def make_output(config: EdgeConfig, name: str, *, is_test: bool = False) -> Output:
    """The output of a table, its settings checked. Raises ConfigError."""
    table, place = config.outputs[name], config.place(f"outputs.{name}")
    try:
        kind = load_output(table.get("kind") or name)
    except UnknownOutputError as error:
        raise ConfigError(f"{place}: {error}") from None
    settings = check_settings(kind.config_model, table, place)
    context = OutputContext(
        name=name,
        site=config.service.site,
        machine=config.service.machine,
        axes=tuple(axis.name for axis in config.axes),
        folder=config.store.folder,
        knows=knows_of(config),
        is_test=is_test,
    )
    try:
        return kind(settings, context)
    except OutputMisconfiguredError as error:
        raise ConfigError(f"{place}.{error}") from None


async def run(context: NodeContext, name: str) -> None:
    """Tell one output until cancelled. Raises ConfigError for what cannot work."""
    output, latest = make_output(context.config, name), LatestAnswers(context)
    reporter = Reporter(context, name)
    reporter.readings = lambda: output.readings
    sender = Sender(output, reporter)
    try:
        async with reporter.running() as tasks:
            if output.takes_answers:
                latest.follow(tasks)
                tasks.start("answers", partial(show, sender, latest))
            await context.forever()
    finally:
        await output.close()


class Sender:
    """Hands messages to an output that may be away or hang, and reports on it."""

    def __init__(self, output: Output, reporter: Reporter) -> None:
        self._output, self._reporter = output, reporter
        self._opening = asyncio.Lock()
        self._problems: dict[str, str] = {}
        reporter.problems = lambda: list(self._problems.values())

    async def send(self, sender: str, message: Message, heart: Heartbeat, retry: Retry) -> bool:
        """Hand a message over; False, after a pause, if the other side is away."""
        output = self._output
        try:
            async with self._opening:
                await heart.patiently(within(output.open_s, output.open()), limit_s=output.open_s)
            await heart.patiently(within(TAKE_S, output.take(message)), limit_s=2.0 * TAKE_S)
        except OutputUnavailableError as error:
            if sender not in self._problems:
                log.warning("%s: %s; trying again", self._output.context.name, error)
            self._problems[sender] = str(error)
            self._reporter.publish()
            await heart.sleep(retry.pause_s())
            return False
        retry.reset()
        was_away = self._problems.pop(sender, None) is not None
        if was_away or self._reporter.status is not ComponentStatus.OK:
            self._reporter.to(ComponentStatus.OK)
        return True


async def within(limit_s: float, work: Coroutine[Any, Any, None]) -> None:
    """Await what the other side may hold up for ever. Raises OutputUnavailableError."""
    try:
        async with asyncio.timeout(limit_s):
            await work
    except TimeoutError:
        raise OutputUnavailableError(f"no answer within {limit_s:g} s") from None


async def show(sender: Sender, latest: LatestAnswers, heart: Heartbeat) -> None:
    """Hand over what is known now of all axes, again and again."""
    retry = Retry(FIRST_PAUSE_S, LONGEST_PAUSE_S)
    while True:
        for answer in latest.now():
            if not await sender.send("answers", answer, heart, retry):
                break
        else:
            await heart.sleep(SHOW_PERIOD_S)
