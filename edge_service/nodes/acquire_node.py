"""One axis' driver in, raw samples out; keeps trying while the machine cannot be reached."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import aclosing

from drivers.base import (
    QUIET_S,
    Driver,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    load_driver,
)

from ..clock import now_ns
from ..config import AxisConfig, ConfigError, check_settings, load_machine
from ..messages.health import ComponentStatus
from ..messages.samples import SampleFrame
from ..messages.topics import PRELOAD, RAW, WAVE
from ..plugins import UnknownPluginError
from ..retry import Retry
from .component import Component
from .context import NodeContext

log = logging.getLogger(__name__)
BACKOFF_FIRST_S, BACKOFF_CAP_S = 0.5, 5.0
LET_GO_S = 10.0  # after which a driver that does not close is left to itself
CREDIT_S = 3.0  # axis time that an unpaced source may run ahead of its estimates
CREDIT_PATIENCE_S = 1.0  # wall time after which it goes on unless something is still unread


def make_driver(axis: AxisConfig, service: str = "") -> Driver:
    """The axis' driver for a service, its settings checked. Raises ConfigError."""
    try:
        driver = load_driver(axis.driver)
    except UnknownPluginError as error:
        raise ConfigError(f"{axis.place}.driver: {error}") from None
    settings = check_settings(driver.config_model, axis.settings, f"{axis.place}.settings")
    try:
        machine = load_machine(axis.machine, axis.number)
        return driver(settings, DriverContext(axis.name, machine, service, axis.place))
    except DriverMisconfiguredError as error:
        raise ConfigError(f"{axis.place}.settings.{error}") from None


async def check_source(axis: AxisConfig) -> str:
    """Check an axis' driver and what it reads; says why that cannot be reached now. ConfigError."""
    driver = make_driver(axis)
    try:
        await driver.probe()
    except DriverUnavailableError as error:
        return f"axis {axis.name}: {error}"
    except DriverMisconfiguredError as error:
        raise ConfigError(f"{axis.place}.settings.{error}") from None
    finally:
        await driver.close()
    return ""


async def run(context: NodeContext, axis: AxisConfig) -> None:
    """Publish the samples of one axis until its source ends. Raises ConfigError, of a replay."""
    acquisition = Acquisition(context, axis)
    component, retry = acquisition.component, Retry(BACKOFF_FIRST_S, BACKOFF_CAP_S)
    away, misconfigured = DriverUnavailableError, DriverMisconfiguredError
    async with component.running():
        try:
            await component.again(acquisition.read, retry, away, misconfigured)
        except DriverMisconfiguredError as error:
            words = f"{axis.place}.settings.{error}"
            if context.is_replay:
                raise ConfigError(words) from None
            log.error("axis %s is not read: %s", axis.name, words)
            component.to(ComponentStatus.PERMANENT_ERROR, words)
            await context.forever()
        finally:
            await acquisition.let_go()


class Acquisition:
    """The driver of one axis, and what is published of it."""

    def __init__(self, context: NodeContext, axis: AxisConfig) -> None:
        self._context, self._axis = context, axis
        self._driver = make_driver(axis, context.config.keys.root)
        self._samples = context.publisher(axis.name, RAW)
        self._waves = context.publisher(axis.name, WAVE)
        self._waits_since_s = float("inf")
        self._counts = {"samples": 0, "frames": 0}
        self.component = component = Component(context, "acquire", axis.name)
        component.counters = lambda: (
            self._counts | {"reconnects": component.restarts} | self._driver.counters
        )
        component.readings = lambda: self._driver.readings
        component.problems = self._silence

    def _silence(self) -> list[str]:
        silent_s = time.monotonic() - self._waits_since_s
        is_silent = silent_s > getattr(self._driver, "quiet_s", QUIET_S)
        return [f"no data for {silent_s:.0f} s"] if is_silent else []

    async def read(self) -> None:
        """Publish until the source ends. Raises the errors of drivers."""
        driver, name = self._driver, self._axis.name
        await driver.open()
        if self.component.status is not ComponentStatus.OK:
            log.info("axis %s: connected to %s", name, self._axis.driver)
        self.component.to(ComponentStatus.OK)
        frames = driver.frames()
        async with aclosing(frames):
            source = frames if driver.paced else self._credited(frames)
            while True:
                self._waits_since_s = time.monotonic()
                try:
                    frame = await anext(source, None)
                finally:
                    self._waits_since_s = float("inf")
                if frame is None:
                    return
                self._counts["samples"] += len(frame)
                self._counts["frames"] += 1
                read_ns = now_ns() - int(1e9 * getattr(driver, "lag_s", 0.0))
                self._samples.publish(frame, read_ns)
                for wave in frame.waveforms:
                    self._waves.publish(wave, read_ns)

    async def let_go(self) -> None:
        """Close the driver; one whose read hangs is left to itself."""
        try:
            async with asyncio.timeout(LET_GO_S):
                await self._driver.close()
        except TimeoutError:
            log.warning("axis %s: the driver does not close; left to itself", self._axis.name)

    async def _credited(self, frames: AsyncIterator[SampleFrame]) -> AsyncIterator[SampleFrame]:
        """Let an unpaced source run CREDIT_S ahead of its estimates: so a replay loses nothing."""
        key = self._context.config.keys.key(self._axis.name, PRELOAD)
        subscriber = self._context.bus.subscribe(key, PRELOAD)
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
                            answered_s = (await anext(answers))[2].time_s
                    except TimeoutError:
                        answers = aiter(subscriber)
                        if not self._context.has_unread():
                            answered_s = newest_s
        finally:
            subscriber.close()
