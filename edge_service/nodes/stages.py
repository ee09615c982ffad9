"""The pure stages of one axis as the configuration asks for them."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..checks.live.channel_limits import channel_limits
from ..config import (
    DEFAULT_MACHINE,
    ConfigError,
    EdgeConfig,
    EstimatorConfig,
    load_machine,
)
from ..downsample import Downsampler, DownsampleSettings
from ..estimate import interface
from ..estimate.interface import PreloadEstimator, UnsuitableMachineError
from ..messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from ..models.machine import Machine
from ..models.steady_limits import SteadyLimits, steady_limits

_WARM_RAD_S = 10.0


def load_machines(config: EdgeConfig) -> dict[str, Machine]:
    """Machine of each axis, by the axis' name. Raises ConfigError."""
    return {axis.name: load_machine(axis.machine) for axis in config.axes}


def make_downsampler(
    machine: Machine, steady: SteadyLimits | None = None, interval_s: float | None = None
) -> Downsampler:
    """The downsampler of one axis: limits and interval from its machine file unless given."""
    steady = steady or steady_limits(machine)
    settings = DownsampleSettings(
        interval_s=interval_s or machine.interval_s,
        max_torque_nm=machine.axis.max_torque_nm,
        min_speed_rad_s=steady.slowest_rad_s,
        cruise_rad_s2=steady.cruise_rad_s2,
        channels=channel_limits(machine),
    )
    return Downsampler(settings, machine.transmission_ratio_m_per_rad)


def make_estimator(config: EstimatorConfig, machine: Machine) -> PreloadEstimator:
    """The configured estimator for one axis. Raises ConfigError if the machine lacks for it."""
    try:
        return interface.make_estimator(config.method, machine, config.engine)
    except UnsuitableMachineError as error:
        raise ConfigError(f"estimator.method {config.method!r}: {error}") from None


def warm_up_downsampling(machines: Iterable[Machine]) -> None:
    """Compile what parts samples into intervals, with and without a linear encoder."""
    for machine in machines:
        steady = _steady(machine)
        table_m = steady.channels[ANGLE] * machine.axis.lead_m / (2.0 * np.pi)
        both = replace(steady, channels={**steady.channels, TABLE_POSITION: table_m})
        for frame in (steady, both):
            make_downsampler(machine).push(frame)


def warm_up(estimator: EstimatorConfig | None = None, machines: Iterable[Machine] = ()) -> None:
    """Compile the kernels before the first sample: it takes seconds on a new installation.

    The motion lasts until the estimators answer: answers are compiled as well.

    Args:
        machines: whose estimators run; the default one's unless given.
    """
    estimator = estimator or EstimatorConfig()
    for machine in tuple(machines) or (load_machine(DEFAULT_MACHINE),):
        warm = make_estimator(estimator, machine)
        for block in make_downsampler(machine).push(_steady(machine)):
            warm.update(block)
            warm.estimate()


def _steady(machine: Machine) -> SampleFrame:
    """Two seconds of motion at one speed.

    A commissioned axis gets the friction that it expects: another torque would mean a process
    force.
    """
    time_s, commissioned = np.arange(2000, dtype=np.float64) / 1e3, machine.commissioned
    friction_nm = 0.1
    if commissioned is not None:
        viscous_nm_s_per_rad = machine.model.viscous_nm_s_per_rad.value
        friction_nm = commissioned.coulomb_nm + _WARM_RAD_S * viscous_nm_s_per_rad
    torque_nm = friction_nm * (1.0 + 0.01 * np.sin(time_s))
    return SampleFrame(time_s, {TORQUE: torque_nm, ANGLE: _WARM_RAD_S * time_s})
