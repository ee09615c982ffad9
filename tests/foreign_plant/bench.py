"""Cases of the diagnosis' bench: some causes, a motion, a seed."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import motions, protocol
from .machine import DIAGNOSIS, Machine
from .simulate import Case

Array = NDArray[np.float64]
MOTIONS: dict[str, Callable[[np.random.Generator, float], Array]] = {
    "production": lambda rng, stroke: motions.production(rng, 90.0, stroke),
    "staircase": protocol.stepped,
    "full": protocol.full,
}


def case(
    effects: tuple[tuple[str, float], ...] = (),
    motion: str | Array = "production",
    seed: int = 0,
    *,
    duration_s: float | None = None,
    machine: Machine = DIAGNOSIS,
    sensors: dict[str, Any] | None = None,
    **options: Any,
) -> Case:
    """`effects` of (name, strength), none: healthy; motion by name, or at 1 kHz."""
    rng = np.random.default_rng([seed, 2])
    if not isinstance(motion, str):
        setpoint = motion
    elif motion == "production" and duration_s is not None:
        setpoint = motions.production(rng, duration_s, machine.stroke_m)
    else:
        setpoint = MOTIONS[motion](rng, machine.stroke_m)
    return Case(
        machine=machine,
        setpoint_m=setpoint,
        seed=seed,
        axis_seed=options.pop("axis_seed", seed),
        effects=effects,
        sensors=sensors or {},
        **options,
    )
