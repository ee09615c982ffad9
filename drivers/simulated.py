"""The simulated feed drive: production motion, wear, and everything a real drive reports."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from edge_service.messages.channels import ANGLE, CHANNELS
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.effect import ActiveEffect
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, MotionError, Setpoints, motion_limits
from edge_service.models.plant.accelerometer import Accelerometer, AccelerometerSettings
from edge_service.models.plant.encoders import Sensors
from edge_service.models.screw.wear import RUN_IN_SHARE, SCENARIOS, Wear
from edge_service.threads import Threads

from .base import (
    DriverConfig,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    Probe,
)
from .rows import LOOK_AHEAD_S

SECONDS_PER_HOUR = 3600.0
GREATEST_LAG_S = 1.0
"""Further behind real time than this, the driver lets the missed time go instead of bursting."""

_SENSORS = Sensors()
_ACCELEROMETER = AccelerometerSettings()


class SimulatedConfig(DriverConfig):
    """Settings of the simulated drive: by default the machine file's axis, worn out in 5 minutes.

    Attributes:
        scenario: how the preload is lost; `healthy` keeps the machine file's fresh preload.
        life_h: wear time from start to end of the scenario, h.
        acceleration: seconds of wear per second of axis time.
        start_percent: preload at first, instead of the scenario's.
        end_percent: preload at last, instead of the scenario's.
        run_in_loss: share of the loss in the first tenth of the life; 0.1 is a straight line.
        hold_s: axis time before the wear begins, s.
        repeat: start anew, with the hold, when the life is over; else the end value stays.
        motion: name of the commanded motion.
        seed: of motion and noise; the same seed gives the same bytes.
        rate_hz: rate of control and samples.
        frame_s: axis time per frame, s.
        speed: axis time over real time; 0 is as fast as possible.
        guide_force_n: guide friction; the machine file's unless given.
        bearing_drag_nm: drag of the screw's bearings; the machine file's unless given.
        effects: what the axis has beyond the machine file, each as NAME[:key=value,...].
        effects_from_s: axis time from which on it has them, s.
        accelerometer_rate_hz: of an accelerometer on the nut; 0 is none.
        ball_pass_order: balls that pass a point of the nut per revolution of the screw; the machine
            file's unless given, that of the test bench where it does not know the balls.
        raceway_damage: what the accelerometer sees when a ball strikes a pit, m/s^2; 0 is sound.
    """

    scenario: Literal["healthy", "gradual", "partial", "sudden"] = "gradual"
    life_h: float = Field(10_000.0, gt=0.0)
    acceleration: float = Field(120_000.0, gt=0.0)
    start_percent: float | None = Field(None, ge=0.0, le=100.0)
    end_percent: float | None = Field(None, ge=0.0, le=100.0)
    run_in_loss: float = Field(RUN_IN_SHARE, ge=0.0, le=1.0)
    hold_s: float = Field(20.0, ge=0.0)
    repeat: bool = False
    motion: str = "production"
    seed: int = Field(1, ge=0)
    rate_hz: float = Field(1000.0, ge=500.0, le=8000.0)
    frame_s: float = Field(0.1, ge=0.001, le=1.0)
    speed: float = Field(1.0, ge=0.0, le=1000.0)
    guide_force_n: float | None = Field(None, ge=0.0)
    bearing_drag_nm: float | None = Field(None, ge=0.0)
    effects: list[str] = []
    effects_from_s: float = Field(0.0, ge=0.0)
    torque_noise_nm: float = Field(_SENSORS.torque_noise_nm, ge=0.0)
    angle_noise_rad: float = Field(_SENSORS.angle_noise_rad, ge=0.0)
    table_noise_m: float = Field(_SENSORS.table_noise_m, ge=0.0)
    accelerometer_rate_hz: float = Field(0.0, ge=0.0, le=100_000.0)
    ball_pass_order: float | None = Field(None, gt=0.0, le=1000.0)
    raceway_damage: float = Field(0.0, ge=0.0)


class _SimulatedAxis:
    """One run of the simulated axis from home: motion, wear clock and feed drive."""

    def __init__(self, config: SimulatedConfig, context: DriverContext) -> None:
        self._config = config
        self._wear = _wear(config, context)
        if config.motion not in MOTIONS:
            known = ", ".join(sorted(MOTIONS))
            raise DriverMisconfiguredError("motion", f"{config.motion!r} is not one of {known}")
        try:
            limits = motion_limits(context.machine)
            segments = MOTIONS[config.motion](limits, np.random.default_rng((config.seed, 1)))
        except MotionError as error:
            raise DriverMisconfiguredError("motion", str(error)) from error
        self._setpoints = Setpoints(segments, limits.low_m, config.rate_hz)
        self.preload_percent = self._wear.start_percent
        settings = _settings(config, context)
        self._later = _later(config)
        try:
            both = replace(settings, effects=(*settings.effects, *self._later))
            FeedDrive(both, limits.low_m, self.preload_percent, config.seed)
            self._drive = FeedDrive(settings, limits.low_m, self.preload_percent, config.seed)
        except ValueError as error:
            raise DriverMisconfiguredError("effects", str(error)) from error
        self._sample = 0
        self._accelerometer = _accelerometer(config, context.machine)

    def advance(self, count: int) -> SampleFrame:
        """The next `count` samples."""
        time_s = np.arange(self._sample, self._sample + count) / self._config.rate_hz
        if self._later and self._sample >= self._config.effects_from_s * self._config.rate_hz:
            self._drive.take_on(self._later)
            self._later = ()
        self._sample += count
        preload_percent = self._preload_percent(time_s)
        if count:
            self.preload_percent = float(preload_percent[-1])
        frame = self._drive.advance(self._setpoints.take(count), preload_percent)
        if self._accelerometer is None or not count:
            return frame
        wave = self._accelerometer.follow(frame.time_s, frame.channels[ANGLE])
        return replace(frame, waveforms=(wave,) if len(wave) else ())

    def _preload_percent(self, time_s: Floats) -> Floats:
        config = self._config
        life_s = config.life_h * SECONDS_PER_HOUR
        if config.repeat:
            time_s = np.fmod(time_s, config.hold_s + life_s / config.acceleration)
        return self._wear.preload_percent((time_s - config.hold_s) * config.acceleration, life_s)


def _later(config: SimulatedConfig) -> tuple[ActiveEffect, ...]:
    """Effects that the axis does not have from the beginning."""
    return tuple(_effects(config)) if config.effects_from_s > 0.0 else ()


def _effects(config: SimulatedConfig) -> list[ActiveEffect]:
    try:
        return [parse_effect(text) for text in config.effects]
    except ValueError as error:
        raise DriverMisconfiguredError("effects", str(error)) from error


def _accelerometer(config: SimulatedConfig, machine: Machine) -> Accelerometer | None:
    if config.accelerometer_rate_hz == 0.0:
        return None
    balls = machine.ball_pass_orders
    known = _ACCELEROMETER.ball_pass_order if balls is None else balls.on_nut
    settings = AccelerometerSettings(
        rate_hz=config.accelerometer_rate_hz,
        ball_pass_order=config.ball_pass_order or known,
        damage=config.raceway_damage,
    )
    return Accelerometer(settings, config.seed)


def _wear(config: SimulatedConfig, context: DriverContext) -> Wear:
    scenario = SCENARIOS[config.scenario]
    fresh = context.machine.fresh_preload_percent
    if config.scenario == "healthy" and fresh is not None:
        scenario = replace(scenario, start_percent=fresh, end_percent=fresh)
    start, end = config.start_percent, config.end_percent
    if config.scenario == "healthy" and end is None:
        end = start
    return replace(
        scenario,
        start_percent=scenario.start_percent if start is None else start,
        end_percent=scenario.end_percent if end is None else end,
        run_in_loss=config.run_in_loss,
    )


def _settings(config: SimulatedConfig, context: DriverContext) -> FeedDriveSettings:
    missing = context.machine.missing_for_percent()
    if missing is not None:
        raise DriverMisconfiguredError(
            "machine", f"{missing}: the machine file lacks it, simulated preload needs it"
        )
    effects = [] if config.effects_from_s > 0.0 else _effects(config)
    try:
        settings = FeedDriveSettings.of_machine(context.machine, config.rate_hz, effects)
    except ValueError as error:
        raise DriverMisconfiguredError("machine", str(error)) from error
    plant = settings.plant
    if config.guide_force_n is not None:
        plant = plant._replace(guide_force_n=config.guide_force_n)
    if config.bearing_drag_nm is not None:
        plant = plant._replace(bearing_drag_nm=config.bearing_drag_nm)
    sensors = settings.sensors._replace(
        torque_noise_nm=config.torque_noise_nm,
        angle_noise_rad=config.angle_noise_rad,
        table_noise_m=config.table_noise_m,
    )
    return replace(settings, plant=plant, sensors=sensors)


class SimulatedDriver:
    """A feed drive that exists only as equations.

    With `speed` above 0 a frame is yielded when its last sample has been taken, against a fixed
    start on the event loop's clock, so that nothing drifts. Axis time never jumps: after a delay
    of more than GREATEST_LAG_S the axis goes on from where it was, and real time has moved on.
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
        self._truth: float | None = None
        self.paced = config.speed > 0.0

    async def open(self) -> None:
        """Put the axis at home; the first time, compile the plant in a thread."""
        if self._running is None:
            work = Threads("simulated")
            axis = await work.run(_SimulatedAxis, self._config, self._context)
            await work.run(self._compile)
            self._running = axis

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of `frame_s` each, without end, until `close`.

        The first is `LOOK_AHEAD_S` longer, see there.
        """
        axis = self._running
        if axis is None:
            raise DriverUnavailableError("the simulated drive is not open")
        config = self._config
        count = max(round(config.frame_s * config.rate_hz), 1)
        clock = self._clock or asyncio.get_running_loop().time
        start_s, taken = clock(), 0
        while self._running is axis:
            rows = count if taken else count + int(LOOK_AHEAD_S * config.rate_hz) + 1
            frame = axis.advance(rows)
            taken += rows
            wait_s = 0.0
            if self.paced:
                due_s = start_s + taken / config.rate_hz / config.speed
                wait_s = due_s - clock()
                if wait_s < -GREATEST_LAG_S:
                    start_s -= wait_s
            await self._sleep(max(wait_s, 0.0))
            if self._running is axis:
                self._truth = axis.preload_percent
                yield frame

    async def probe(self) -> Probe:
        """Channels and rate; raises DriverMisconfiguredError as `open` does."""
        _SimulatedAxis(self._config, self._context)
        return Probe(
            f"simulated feed drive, scenario {self._config.scenario}",
            tuple(CHANNELS),
            self._config.rate_hz,
        )

    async def close(self) -> None:
        """End `frames`; the next `open` starts from home again."""
        self._running = None
        self._truth = None

    @property
    def counters(self) -> dict[str, int]:
        """None: nothing is ever lost here."""
        return {}

    @property
    def readings(self) -> dict[str, float]:
        """The true preload, to hold the estimate against."""
        return {} if self._truth is None else {"true_preload_percent": self._truth}

    def truth(self) -> float | None:
        """True preload in percent at the latest sample handed out, or None before the first."""
        return self._truth

    def _compile(self) -> None:
        _SimulatedAxis(self._config, self._context).advance(1)
