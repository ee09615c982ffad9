"""Cases of the diagnosis' bench: some causes, a motion, a seed."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import motions, protocol
from .machine import DIAGNOSIS, Machine
from .simulate import Case, on_grid

Array = NDArray[np.float64]

MOTIONS: dict[str, Callable[[np.random.Generator, float], Array]] = {
    "production": lambda rng, stroke: motions.production(rng, 90.0, stroke),
    "staircase": protocol.stepped,
    "full": protocol.full,
    "one_speed": protocol.one_speed,
    "one_place": protocol.one_place,
    "cold_and_warm": protocol.cold_and_warm,
    "commissioning": lambda rng, stroke: motions.commissioning(stroke),
}


def case(
    effects: tuple[tuple[str, float], ...] = (),
    motion: str | Array | tuple[Array, Array] = "production",
    seed: int = 0,
    *,
    duration_s: float | None = None,
    machine: Machine = DIAGNOSIS,
    drift: float = 0.01,
    sensors: dict[str, Any] | None = None,
    **options: Any,
) -> Case:
    """`effects` of (name, strength), none: healthy; motion by name, at 1 kHz or (times, m)."""
    rng = np.random.default_rng([seed, 2])
    if isinstance(motion, tuple):
        setpoint = on_grid(*motion)
    elif not isinstance(motion, str):
        setpoint = motion
    elif motion == "production" and duration_s is not None:
        setpoint = motions.production(rng, duration_s, machine.stroke_m)
    else:
        setpoint = MOTIONS[motion](rng, machine.stroke_m)
    return Case(
        machine=machine,
        time_s=np.arange(len(setpoint)) * motions.STEP_S,
        setpoint_m=setpoint,
        seed=seed,
        axis_seed=options.pop("axis_seed", seed),
        effects=effects,
        drift=drift,
        sensors=sensors or {},
        **options,
    )
