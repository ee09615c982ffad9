"""The simulated feed drive: production motion, wear, and everything a real drive reports."""

import asyncio
import math
import tomllib
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError

from edge_service.messages.samples import ANGLE, CHANNELS, Floats, SampleFrame
from edge_service.models.effects.effect import ActiveEffect
from edge_service.models.effects.library.external_force import force_profile, process_force
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits
from edge_service.models.plant.accelerometer import Accelerometer, AccelerometerSettings
from edge_service.threads import Threads

from .base import (
    DriverConfig,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    Probe,
)
from .rows import FRAME_S, LOOK_AHEAD_S, Pace

_FROM = "from_s="


class Wear(NamedTuple):
    """Preload over wear time: straight from start to end, or all at once at half of the life."""

    start_percent: float  # of the dynamic load rating, at wear time 0
    end_percent: float  # from the end of the life on
    is_sudden: bool = False

    def preload_percent(self, wear_time_s: Floats, life_s: float) -> Floats:
        """Preload at wear times (n,), s, of a life of `life_s`; percent of the load rating."""
        age = np.clip(wear_time_s / life_s, 0.0, 1.0)
        lost = np.where(age < 0.5, 0.0, 1.0) if self.is_sudden else age
        return self.start_percent + lost * (self.end_percent - self.start_percent)


SCENARIOS: dict[str, Wear] = {
    "healthy": Wear(10.0, 10.0),
    "gradual": Wear(10.0, 0.0),
    "partial": Wear(7.5, 2.5),
    "sudden": Wear(10.0, 0.0, is_sudden=True),
}
"""The thesis' simulations 3, 1, 2 and 4 (4.6), by name."""


class SimulatedConfig(DriverConfig):
    """Settings of the simulated drive; `deploy/drivers/simulated.toml` tells of each."""

    scenario: Literal["healthy", "gradual", "partial", "sudden"] = "gradual"
    start_percent: float | None = Field(None, ge=0.0, le=100.0)
    end_percent: float | None = Field(None, ge=0.0, le=100.0)
    life_s: float = Field(300.0, gt=0.0)  # axis time from start to end of the scenario, s
    hold_s: float = Field(20.0, ge=0.0)  # axis time before the wear begins, s
    repeat: bool = False
    motion: str = "production"  # name of the commanded motion
    seed: int = Field(1, ge=0)  # of motion and noise; the same seed gives the same bytes
    rate_hz: float = Field(1000.0, ge=500.0, le=8000.0)  # rate of control and samples
    speed: float = Field(1.0, ge=0.0, le=1000.0)
    truth: Path | None = None
    effects: list[str] = []
    noise: float = Field(1.0, ge=0.0, le=1000.0)  # of torque and encoders, times the usual one
    accelerometer_hz: float = Field(0.0, ge=0.0, le=100_000.0)
    raceway_damage: float = Field(0.0, ge=0.0)
    force: float = 0.0  # external force on the table, N, positive along the travel
    process: Literal["steady", "milling", "drilling"] = "steady"  # whose force `force` is
    force_file: Path | None = None  # columns time_s, force_n, which begin anew at their end


class _SimulatedAxis:
    """One run of the simulated axis from home: motion, wear clock and feed drive."""

    def __init__(self, config: SimulatedConfig, context: DriverContext) -> None:
        self._config = config
        machine = context.machine if config.truth is None else _machine(config.truth)
        whose = "machine" if config.truth is None else "truth"
        missing = machine.missing_for_percent()
        if missing is not None and config.start_percent != 0.0:
            words = f"{missing}: the machine file lacks it, simulated preload needs it"
            raise DriverMisconfiguredError(whose, words)
        self._wear = _wear(config, machine)
        self.preload_percent = self._wear.start_percent
        if config.motion not in MOTIONS:
            known = ", ".join(sorted(MOTIONS))
            raise DriverMisconfiguredError("motion", f"{config.motion!r} is not one of {known}")
        key = "motion"
        try:
            limits = motion_limits(machine)
            segments = MOTIONS[config.motion](limits, np.random.default_rng((config.seed, 1)))
            key = whose
            settings = FeedDriveSettings.of_machine(machine, config.rate_hz)
            key = "effects"
            effects = [_effect(text) for text in config.effects]
            settings = replace(settings, sensors=settings.sensors.noisier(config.noise))
            for begun_s in (math.inf, 0.0):  # first all of them, so that a wrong one is told now
                present = tuple(effect for from_s, effect in effects if from_s <= begun_s)
                now = replace(settings, effects=(*settings.effects, *present))
                self._drive = FeedDrive(now, limits.low_m, self.preload_percent, config.seed)
            key, file = "force_file", config.force_file
            self._profile = None if file is None else force_profile(file.read_text("utf-8"))
        except (OSError, ValueError) as error:
            raise DriverMisconfiguredError(key, str(error)) from error
        self._later = [(from_s, effect) for from_s, effect in effects if from_s > 0.0]
        self._setpoints = Setpoints(segments, limits.low_m, config.rate_hz)
        self._sample = 0
        self._accelerometer: Accelerometer | None = None
        if config.accelerometer_hz > 0.0:
            rate_hz, damage = config.accelerometer_hz, config.raceway_damage
            sensor = AccelerometerSettings(rate_hz=rate_hz, damage=damage)
            if machine.ball_pass_orders is not None:
                sensor = replace(sensor, ball_pass_order=machine.ball_pass_orders.on_nut)
            self._accelerometer = Accelerometer(sensor, config.seed)

    def advance(self, count: int) -> SampleFrame:
        config = self._config
        time_s = np.arange(self._sample, self._sample + count) / config.rate_hz
        begun = [effect for from_s, effect in self._later if from_s <= time_s[0]]
        if begun:
            self._drive.take_on(begun)
            self._later = [each for each in self._later if each[0] > time_s[0]]
        self._sample += count
        force_n = process_force(config.process, config.force, time_s)
        if self._profile is not None:
            force_n += np.interp(np.fmod(time_s, self._profile[0, -1]), *self._profile)
        if config.repeat:
            time_s = np.fmod(time_s, config.hold_s + config.life_s)
        preload_percent = self._wear.preload_percent(time_s - config.hold_s, config.life_s)
        self.preload_percent = float(preload_percent[-1])
        setpoints = self._setpoints.take(count)
        frame = self._drive.advance(setpoints, preload_percent, external_force_n=force_n)
        if self._accelerometer is None:
            return frame
        wave = self._accelerometer.follow(frame.time_s, frame.channels[ANGLE])
        return replace(frame, waveforms=(wave,) if len(wave) else ())


def _wear(config: SimulatedConfig, machine: Machine) -> Wear:
    scenario, is_healthy = SCENARIOS[config.scenario], config.scenario == "healthy"
    start, end = config.start_percent, config.end_percent
    if start is None:
        start = (is_healthy and machine.fresh_preload_percent) or scenario.start_percent
    if end is None:
        end = start if is_healthy else scenario.end_percent
    return scenario._replace(start_percent=start, end_percent=end)


def _machine(path: Path) -> Machine:
    """The machine file that is the truth. Raises DriverMisconfiguredError."""
    try:
        return Machine.model_validate(tomllib.loads(path.read_text("utf-8")))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise DriverMisconfiguredError("truth", f"{path}: {place}: {first['msg']}") from None
    except (OSError, ValueError) as error:
        raise DriverMisconfiguredError("truth", f"{path}: {error}") from None


def _effect(text: str) -> tuple[float, ActiveEffect]:
    """Axis time from which on an effect is there, s, and the effect. Raises ValueError."""
    name, _, rest = text.partition(":")
    parts = [part.strip() for part in rest.split(",")]
    times = [part.removeprefix(_FROM) for part in parts if part.startswith(_FROM)]
    others = ",".join(part for part in parts if not part.startswith(_FROM))
    try:
        from_s = float(times[-1]) if times else 0.0
    except ValueError:
        raise ValueError(f"effect {name}: from_s: expected seconds, got {times[-1]!r}") from None
    return from_s, parse_effect(f"{name}:{others}")


class SimulatedDriver:
    """A feed drive that exists only as equations.

    With `speed` above 0 a frame is yielded when its last sample has been taken, against a fixed
    start on the event loop's clock, so that nothing drifts. Axis time never jumps: after a delay
    of more than a second the axis goes on from where it was, and real time has moved on. Its
    `readings` hold the true preload.
    """

    config_model: ClassVar[type[DriverConfig]] = SimulatedConfig

    def __init__(
        self,
        config: SimulatedConfig,
        context: DriverContext,
        *,
        clock: Callable[[], float] | None = None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._config = config
        self._context = context
        self._clock = clock
        self._sleep = sleep
        self._running: _SimulatedAxis | None = None
        self.counters: dict[str, int] = {}
        self.readings: dict[str, float] = {}
        self.paced = config.speed > 0.0
        self.frame_s = FRAME_S

    async def open(self) -> None:
        """Put the axis at home; the first time, compile the plant in a thread."""
        if self._running is None:
            work = Threads("simulated")
            axis = await work.run(_SimulatedAxis, self._config, self._context)
            compiled = await work.run(_SimulatedAxis, self._config, self._context)
            await work.run(compiled.advance, 1)
            self._running = axis

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of `frame_s` each, without end, until `close`.

        The first is `LOOK_AHEAD_S` longer, see there.
        """
        axis = self._running
        if axis is None:
            raise DriverUnavailableError("the simulated drive is not open")
        config = self._config
        count = max(round(self.frame_s * config.rate_hz), 1)
        pace = Pace(config.speed, self._clock or asyncio.get_running_loop().time)
        rows = count + int(LOOK_AHEAD_S * config.rate_hz) + 1
        while self._running is axis:
            frame = axis.advance(rows)
            await self._sleep(pace.wait_s(rows / config.rate_hz))
            rows = count
            if self._running is axis:
                self.readings = {"true_preload_percent": axis.preload_percent}
                yield frame

    async def probe(self) -> Probe:
        _SimulatedAxis(self._config, self._context)
        words = f"simulated feed drive, scenario {self._config.scenario}"
        return Probe(words, tuple(CHANNELS), self._config.rate_hz)

    async def close(self) -> None:
        self._running = None
        self.readings = {}
