"""The pure stages of one axis as the configuration asks for them."""

from collections.abc import Iterable

import numpy as np

from ...config import (
    DEFAULT_MACHINE,
    ConfigError,
    DownsampleConfig,
    EdgeConfig,
    EstimatorConfig,
    load_machine,
)
from ...downsample import Downsampler, DownsampleSettings
from ...downsample.channel_limits import channel_limits
from ...downsample.phases import PhaseSettings
from ...downsample.statistics import PlausibilitySettings
from ...estimate.imm.estimator import ImmPreloadEstimator, ImmSettings
from ...estimate.interface import PreloadEstimator
from ...estimate.mixture.estimator import FusedPreloadEstimator
from ...messages.channels import ANGLE, TORQUE
from ...messages.samples import SampleFrame
from ...models.machine import Machine
from ...models.steady_limits import SteadyLimits, steady_limits

_WARM_RAD_S = 10.0


def load_machines(config: EdgeConfig) -> dict[str, Machine]:
    """Machine of each axis, by the axis' name. Raises ConfigError."""
    return {axis.name: load_machine(axis.machine) for axis in config.axes}


def make_downsampler(
    config: DownsampleConfig, machine: Machine, steady: SteadyLimits | None = None
) -> Downsampler:
    """The downsampler of one axis: limits from its machine file unless given."""
    steady = steady or steady_limits(machine)
    limits = PlausibilitySettings(
        max_torque_nm=machine.axis.max_torque_nm,
        phases=PhaseSettings(
            min_speed_rad_s=steady.slowest_rad_s, cruise_rad_s2=steady.cruise_rad_s2
        ),
    )
    return Downsampler(
        DownsampleSettings(
            interval_s=config.interval_s, plausibility=limits, channels=channel_limits(machine)
        ),
        machine.transmission_ratio_m_per_rad,
    )


def make_estimator(config: EstimatorConfig, machine: Machine) -> PreloadEstimator:
    """The configured estimator for one axis. Raises ConfigError if the machine lacks for it."""
    able = machine.commissioned is not None and machine.drag_per_percent_nm is not None
    if config.method == "fused" and not able:
        raise ConfigError(
            "estimator.method 'fused': needs a machine file written by `edge-service commission` "
            "with model.preload_n, model.preload_drag_nm and axis.dynamic_load_rating_n"
        )
    if able and config.method in ("auto", "fused"):
        return FusedPreloadEstimator(machine)
    return ImmPreloadEstimator(
        machine,
        ImmSettings(
            method="sif-imm" if config.method == "sif-imm" else "kf-imm",
            engine=config.engine,
            activation_exponent=config.activation_exponent,
            window_s=config.window_s,
        ),
    )


def warm_up(
    downsample: DownsampleConfig | None = None,
    estimator: EstimatorConfig | None = None,
    machines: Iterable[Machine] = (),
) -> None:
    """Compile the kernels before the first sample: it takes seconds on a new installation.

    The motion lasts until the estimators answer: answers are compiled as well. A commissioned axis
    gets the friction that it expects: another torque would mean a process force.

    Args:
        machines: whose estimators run; the default one's unless given.
    """
    downsample, estimator = downsample or DownsampleConfig(), estimator or EstimatorConfig()
    time_s = np.arange(2000, dtype=np.float64) / 1e3
    for machine in tuple(machines) or (load_machine(DEFAULT_MACHINE),):
        warm, commissioned = make_estimator(estimator, machine), machine.commissioned
        viscous_nm_s_per_rad = machine.model.viscous_nm_s_per_rad.value
        friction_nm = 0.1
        if commissioned is not None:
            friction_nm = commissioned.coulomb_nm + _WARM_RAD_S * viscous_nm_s_per_rad
        torque_nm = friction_nm * (1.0 + 0.01 * np.sin(time_s))
        steady = SampleFrame(time_s, {TORQUE: torque_nm, ANGLE: _WARM_RAD_S * time_s})
        for block in make_downsampler(downsample, machine).push(steady):
            warm.update(block)
            warm.estimate()
