"""Cases of the estimator's bench: production on an axis that ages, and its commissioning."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import motions
from .ageing import Event, PreloadSpec
from .machine import Machine
from .simulate import Case

Array = NDArray[np.float64]


def axis_case(
    preload: PreloadSpec | None = None,
    *,
    duration_s: float = 60.0,
    events: tuple[Event, ...] = (),
    seed: int = 0,
    axis_seed: int = 0,
    setpoint_m: Array | None = None,
    machine: Machine | None = None,
    stroke_map: tuple[float, float] = (0.05, 0.03),
) -> Case:
    """Production, or the given setpoints, on the axis of `axis_seed`."""
    machine = machine or Machine()
    if setpoint_m is None:
        setpoint_m = motions.production(
            np.random.default_rng([seed, 1]), duration_s, machine.stroke_m
        )
    return Case(
        machine=machine,
        setpoint_m=setpoint_m,
        seed=seed,
        axis_seed=axis_seed,
        preload=preload,
        events=events,
        stroke_map=stroke_map,
    )


def commissioning_case(*, axis_seed: int = 0, seed: int = 1000, **options: Any) -> Case:
    """The healthy, cold axis of `axis_seed` on a rich motion."""
    machine = options.get("machine") or Machine()
    return axis_case(
        setpoint_m=motions.commissioning(machine.stroke_m),
        seed=seed,
        axis_seed=axis_seed,
        **options,
    )
