"""Wording of a fingerprint for a maintenance engineer: titles, meaning, names."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from ...fingerprint.result import Section
from ...regression.interval_estimate import IntervalEstimate


class Wording(NamedTuple):
    """Title and meaning of a section; what the names of its `most` chief figures begin with."""

    title: str
    meaning: str
    headline: tuple[str, ...]
    most: int = 3


WORDING: Mapping[str, Wording] = {
    "friction": Wording(
        "Friction",
        "The torque needed to move at constant speed. Its level follows preload and lubrication; a "
        "rise at low speed points to thin lubrication, and the slope depends on the grease.",
        ("coulomb_nm", "viscous_nm_s_per_rad", "stribeck_excess_nm"),
    ),
    "friction_runs": Wording(
        "Friction from test to test",
        "The friction tests of the session from first to last. A fall at low speed means that the "
        "lubricant warms up; the change is from the first test to the last.",
        ("change_at_",),
        most=1,
    ),
    "stiffness": Wording(
        "Stiffness along the stroke",
        "How hard it is to push the table away from where the motor holds it; the locked resonance "
        "is the frequency at which the table then swings. A softer axis at all places points to "
        "the nut or the bearing.",
        ("stiffness_", "locked_resonance_"),
    ),
    "backlash": Wording(
        "Backlash and lost motion",
        "How far the table lags behind when the motor reverses: wind-up by friction, and play.",
        ("lost_motion_",),
    ),
    "equability": Wording(
        "Evenness",
        "How much the torque varies at constant speed. A rise means rough running.",
        ("ripple_",),
    ),
    "signature": Wording(
        "Signature",
        "Where in each turn of the screw the torque varies: once per turn points to a bent or "
        "misaligned screw, higher orders to the balls and their return.",
        ("once_per_rev_", "balls_"),
    ),
    "reversal_error": Wording(
        "Reversal error",
        "What a slow change of direction leaves on the workpiece, as on the quadrants of a circle.",
        ("following_peak_m", "encoder_step_m"),
    ),
    "frequency_response": Wording(
        "Frequency response",
        "How the motor answers a torque at each frequency. Falling modes mean a softer drive.",
        ("antiresonance_hz", "resonance_hz", "response_inertia_kg_m2"),
    ),
    "inertia": Wording(
        "Inertia", "The inertia of the whole axis, as the motor sees it.", ("inertia_kg_m2",)
    ),
    "preload": Wording(
        "Preload of the nut",
        "From the drag, which guides and bearings also affect, and from the stiffness compared "
        "with that of the fresh axis.",
        ("preload_from_drag_n", "preload_from_stiffness_n"),
    ),
}
_NAMES = ("Coulomb", "Stribeck")
_UNITS = ("nm_s_per_rad", "nm_per_rad", "n_per_m", "rad_s", "kg_m2", "nm", "hz", "n", "m", "s")


def headline(name: str, section: Section) -> dict[str, IntervalEstimate]:
    """The chief figures of a section, as far as they have a number, the most telling first."""
    wording = WORDING[name]
    chief = [
        (key, figure)
        for start in wording.headline
        for key, figure in section.figures.items()
        if key.startswith(start) and math.isfinite(figure.value)
    ]
    return dict(chief[: wording.most])


def plain(name: str) -> str:
    """A figure's name in words, its unit left out.

    >>> plain("friction.level_15_rpm_nm")
    'friction: level 15 rpm'
    >>> plain("backlash.backlash_at_400_mm_m")
    'backlash at 400 mm'
    """
    section, _, key = name.rpartition(".")
    ending = next((f"_{each}" for each in _UNITS if key.endswith(f"_{each}")), "")
    key = key.removesuffix(ending)
    words = key.replace("_", " ")
    for proper in _NAMES:
        words = words.replace(proper.lower(), proper)
    place = section.replace("_", " ")
    return words if not section or words.startswith(place) else f"{place}: {words}"
