"""One axis' driver in, raw samples out; keeps trying while the machine cannot be reached."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import aclosing, contextmanager

from drivers.base import (
    QUIET_S,
    Driver,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
)
from drivers.registry import UnknownDriverError, load_driver

from ..bus.publisher import Publisher
from ..clock import now_ns
from ..config import AxisConfig, ConfigError, check_settings, load_machine
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import PRELOAD, RAW, WAVE
from ..messages.waveform import Waveform
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter

log = logging.getLogger(__name__)
BACKOFF_FIRST_S, BACKOFF_CAP_S = 0.5, 5.0
OPEN_S, LET_GO_S = 60.0, 10.0  # beyond which a driver that opens or closes is shown, or left
CREDIT_S = 3.0  # axis time that an unpaced source may run ahead of its estimates
CREDIT_PATIENCE_S = 1.0  # wall time after which it goes on without an answer


def make_driver(axis: AxisConfig) -> Driver:
    """The axis' driver, its settings checked. Raises ConfigError."""
    try:
        driver = load_driver(axis.driver)
    except UnknownDriverError as error:
        raise ConfigError(f"{axis.place}.driver: {error}") from None
    settings = check_settings(driver.config_model, axis.settings, f"{axis.place}.settings")
    try:
        return driver(settings, DriverContext(axis.name, load_machine(axis.machine)))
    except DriverMisconfiguredError as error:
        raise ConfigError(f"{axis.place}.settings.{error}") from None


async def run(context: NodeContext, axis: AxisConfig) -> None:
    """Publish the samples of one axis until its source ends or the task is cancelled."""
    driver = make_driver(axis)
    publisher = context.publisher(axis.name, RAW)
    waves = context.publisher(axis.name, WAVE)
    reporter = Reporter(context, "acquire", axis.name)
    counts = {"samples": 0, "frames": 0, "reconnects": 0}
    reporter.counters = lambda: counts | driver.counters
    reporter.readings = lambda: driver.readings
    silence = Silence(getattr(driver, "quiet_s", QUIET_S))
    reporter.problems = silence.problems

    async def read(heart: Heartbeat) -> None:
        """Read until the source ends. Raises ConfigError if the driver's settings cannot work."""
        try:
            while lost := await _read(
                context, axis, driver, publisher, waves, reporter, counts, silence, heart
            ):
                await _retry_later(reporter, counts, lost, heart)
        except DriverMisconfiguredError as error:
            raise ConfigError(f"{axis.place}.settings.{error}") from None
        finally:
            await _let_go(axis.name, driver)

    async with reporter.running() as tasks:
        with context.heart.idle():
            await tasks.start("read", read, may_end=True).done.wait()


async def _read(
    context: NodeContext,
    axis: AxisConfig,
    driver: Driver,
    publisher: Publisher[SampleFrame],
    waves: Publisher[Waveform],
    reporter: Reporter,
    counts: dict[str, int],
    silence: "Silence",
    heart: Heartbeat,
) -> DriverUnavailableError | None:
    """Read until the source ends (None) or is lost (the error)."""
    try:
        await heart.patiently(driver.open(), limit_s=OPEN_S)
        if reporter.status is not ComponentStatus.OK:
            log.info("axis %s: connected to %s", axis.name, axis.driver)
        reporter.to(ComponentStatus.OK)
        frames = driver.frames()
        async with aclosing(frames):
            source = frames if driver.paced else _credited(context, axis.name, frames)
            while True:
                with silence.of_source(), heart.idle():  # it may be silent, but says so
                    frame = await anext(source, None)
                if frame is None:
                    break
                counts["samples"] += len(frame)
                counts["frames"] += 1
                read_ns = now_ns()
                publisher.publish(frame, read_ns)
                for wave in frame.waveforms:
                    waves.publish(wave, read_ns)
    except DriverUnavailableError as error:
        return error
    return None


class Silence:
    """Time for which a source has said nothing.

    Args:
        quiet_s: longest time that is no problem, s.
    """

    def __init__(self, quiet_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._quiet_s, self._clock = quiet_s, clock
        self._since_s: float | None = None

    @contextmanager
    def of_source(self) -> Iterator[None]:
        """Wait inside for what it says next."""
        self._since_s = self._clock()
        try:
            yield
        finally:
            self._since_s = None

    def problems(self) -> list[str]:
        """Say that it is silent, and for how long."""
        silent_s = 0.0 if self._since_s is None else self._clock() - self._since_s
        return [f"no data for {silent_s:.0f} s"] if silent_s > self._quiet_s else []


async def _let_go(axis: str, driver: Driver) -> None:
    """Close a driver; one whose read hangs is left to itself."""
    try:
        async with asyncio.timeout(LET_GO_S):
            await driver.close()
    except TimeoutError:
        log.warning("axis %s: the driver does not close; going on without it", axis)


async def _retry_later(
    reporter: Reporter, counts: dict[str, int], lost: DriverUnavailableError, heart: Heartbeat
) -> None:
    if reporter.status is not ComponentStatus.RECOVERABLE_ERROR:
        log.warning("connection lost: %s; trying again", lost)
        counts["tries"] = 0
    reporter.to(ComponentStatus.RECOVERABLE_ERROR, str(lost))
    counts["reconnects"] += 1
    counts["tries"] = counts.get("tries", 0) + 1
    await heart.sleep(min(BACKOFF_CAP_S, BACKOFF_FIRST_S * 2.0 ** min(counts["tries"] - 1, 10)))


async def _credited(
    context: NodeContext, axis: str, frames: AsyncIterator[SampleFrame]
) -> AsyncIterator[SampleFrame]:
    """Let an unpaced source run at most CREDIT_S ahead of the estimates that come back.

    So a recording replayed flat out loses nothing although no reader ever blocks the bus.
    """
    subscriber = context.bus.subscribe(context.config.keys.key(axis, PRELOAD), PRELOAD)
    answers = aiter(subscriber)
    answered_s: float | None = None
    try:
        async for frame in frames:
            yield frame
            newest_s = float(frame.time_s[-1])
            answered_s = float(frame.time_s[0]) if answered_s is None else answered_s
            while newest_s - answered_s > CREDIT_S:
                try:
                    async with asyncio.timeout(CREDIT_PATIENCE_S):
                        _, _, estimate = await anext(answers)
                    answered_s = estimate.time_s
                except TimeoutError:
                    answered_s = newest_s
                    answers = aiter(subscriber)
    finally:
        subscriber.close()
