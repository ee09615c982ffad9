"""Units in which machines speak, and the way to SI."""

import math

SI: dict[str, tuple[float, str]] = {
    "m": (1.0, "m"),
    "mm": (1e-3, "m"),
    "um": (1e-6, "m"),
    "m/s": (1.0, "m/s"),
    "mm/s": (1e-3, "m/s"),
    "mm/min": (1e-3 / 60.0, "m/s"),
    "m/min": (1.0 / 60.0, "m/s"),
    "rad": (1.0, "rad"),
    "deg": (math.pi / 180.0, "rad"),
    "rev": (2.0 * math.pi, "rad"),
    "rad/s": (1.0, "rad/s"),
    "deg/s": (math.pi / 180.0, "rad/s"),
    "rev/s": (2.0 * math.pi, "rad/s"),
    "rev/min": (2.0 * math.pi / 60.0, "rad/s"),
    "N m": (1.0, "N m"),
    "mN m": (1e-3, "N m"),
    "N": (1.0, "N"),
    "kN": (1e3, "N"),
    "degC": (1.0, "degC"),
}
"""Unit -> factor to SI, SI unit. Degrees Celsius stand for themselves."""


def factor_to(unit: str, wanted: str, lead_m: float) -> float | None:
    """Factor from `unit` to the SI unit `wanted`; None where they measure different things.

    Travel of the table and turning of the screw are linked by the lead, 2 pi / lead rad per m.
    """
    factor, si_unit = SI[unit]
    turning = 2.0 * math.pi / lead_m
    links = {("m", "rad"): turning, ("m/s", "rad/s"): turning}
    links |= {(turned, moved): 1.0 / turning for moved, turned in links}
    if si_unit == wanted:
        return factor
    link = links.get((si_unit, wanted))
    return None if link is None else factor * link
