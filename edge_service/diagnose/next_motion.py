"""The motion that would decide between explanations that a recording cannot tell apart."""

from collections.abc import Collection

DECIDING: dict[frozenset[str], str] = {
    frozenset({"load_offset", "external_force"}): "standstill",
    frozenset({"inertia_error", "torque_gain_error"}): "friction",
    frozenset({"drag_error", "torque_gain_error"}): "acceleration",
    frozenset({"drag_error", "load_friction"}): "acceleration",
    frozenset({"inertia_error", "load_friction"}): "acceleration",
    frozenset({"lead_error", "encoder_eccentricity"}): "signature",
    frozenset({"lead_error", "thermal_growth"}): "warmup",
    frozenset({"drag_error", "warmup"}): "warmup",
    frozenset({"warmup", "external_force"}): "warmup",
    frozenset({"backlash", "compliance"}): "acceleration",
    frozenset({"backlash", "presliding"}): "reversals",
    frozenset({"compliance", "timestamp_skew"}): "acceleration",
    frozenset({"presliding", "stribeck"}): "friction",
    frozenset({"viscous_error", "quadratic_friction"}): "friction",
    frozenset({"quadratic_friction", "stribeck"}): "friction",
    frozenset({"drag_error", "stribeck"}): "friction",
    frozenset({"position_friction", "stribeck"}): "friction",
    frozenset({"torque_ripple", "once_per_rev_friction"}): "signature",
    frozenset({"delay", "inertia_error"}): "chirp",
    frozenset({"delay", "presliding"}): "chirp",
}
"""Pairs that are easily taken for one another, and the motion that shows them apart."""


def deciding_motion(tied: Collection[str]) -> str:
    """Name of the motion; the full protocol where nothing shorter is known to do."""
    for pair, motion in DECIDING.items():
        if pair <= set(tied):
            return motion
    return "full"
