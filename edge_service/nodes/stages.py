"""The pure stages of one axis as the configuration asks for them."""

import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

from ..checks.live.channel_limits import channel_limits
from ..config import ConfigError, EdgeConfig, EstimatorConfig, load_config, load_machine
from ..downsample import Downsampler, DownsampleSettings
from ..estimate import interface
from ..estimate.interface import PreloadEstimator, UnsuitableMachineError
from ..messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from ..models.machine import Machine
from ..models.steady_limits import SteadyLimits, steady_limits
from ..process import end_with_parent, finished
from ..threads import Threads
from .estimated_axis import identity_of

PREPARING = "numeric kernels are being loaded, or compiled, for a minute after an upgrade"
THESIS_METHOD = "kf-imm"
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


def make_beside(config: EstimatorConfig, machine: Machine) -> PreloadEstimator:
    """The thesis' own estimator for one axis, for a second opinion."""
    return interface.make_estimator(THESIS_METHOD, machine, config.engine)


async def prepare(config: EdgeConfig, machines: tuple[Machine, ...]) -> None:
    """Compile the kernels; if they can be kept, in a process that ends: that takes 300 MB."""
    marks = _marks(config.estimator, machines)
    if config.file and not all(each.exists() for each in marks):
        with suppress(OSError, TimeoutError):
            words = (sys.executable, "-m", __name__, str(config.file))
            await finished(program=words, nice=0, limit_s=1800.0)
    await Threads("kernels").run(warm_up, config.estimator, machines)


def warm_up(estimator: EstimatorConfig, machines: Iterable[Machine]) -> None:
    """Let every kernel run, with and without a linear encoder, until the estimators answer."""
    for machine in machines:
        steady = _steady(machine)
        warm = make_estimator(estimator, machine), make_beside(estimator, machine)
        table_m = steady.channels[ANGLE] * machine.axis.lead_m / (2.0 * np.pi)
        both = replace(steady, channels={**steady.channels, TABLE_POSITION: table_m})
        make_downsampler(machine).push(both)
        for block in make_downsampler(machine).push(steady):
            for each in warm:
                each.update(block)
                each.estimate()
        for mark in _marks(estimator, (machine,)):
            with suppress(OSError):
                mark.touch()


def _marks(estimator: EstimatorConfig, machines: Iterable[Machine]) -> list[Path]:
    """Files, one a machine, that say that its kernels are kept; none if they cannot be."""
    folder = getattr(numba.config, "CACHE_DIR", "")
    return [Path(folder) / identity_of(each, estimator) for each in machines if folder]


def _steady(machine: Machine) -> SampleFrame:
    """Two seconds at one speed, against the friction that is expected: more would be a force."""
    time_s, commissioned = np.arange(2000, dtype=np.float64) / 1e3, machine.commissioned
    friction_nm = 0.1
    if commissioned is not None:
        viscous_nm_s_per_rad = machine.model.viscous_nm_s_per_rad.value
        friction_nm = commissioned.coulomb_nm + _WARM_RAD_S * viscous_nm_s_per_rad
    torque_nm = friction_nm * (1.0 + 0.01 * np.sin(time_s))
    return SampleFrame(time_s, {TORQUE: torque_nm, ANGLE: _WARM_RAD_S * time_s})


if __name__ == "__main__":
    end_with_parent()
    chosen = load_config(Path(sys.argv[1]))
    warm_up(chosen.estimator, load_machines(chosen).values())
