"""Changes of a section in the words of the shop."""

import math
from collections.abc import Sequence

from ...fingerprint.drift.changes import Drift, SectionDrift
from ...fingerprint.drift.sections import described
from ..report.quantities import amount, estimate

QUANTITIES = {
    "friction_nm": "friction (torque that turns with the direction)",
    "load_nm": "load (torque that does not: gravity, counterweight, offset)",
    "torque_nm": "torque, friction and load together, for there is no way back",
    "torque_spread_nm": "spread of the torque along the move",
    "lag_m": "following error that turns with the direction",
    "offset_m": "following error that does not",
    "following_error_m": "following error",
    "lost_motion_m": "stretch between the encoders that turns with the direction",
    "stretch_m": "stretch between the encoders; for both ways what does not turn",
}
"""Quantity -> what it is."""
_DEAF_TO_HEAT = ("load_nm",)


def place(each: SectionDrift, by: Sequence[str]) -> str:
    """A section in words: its move, and what else tells it from others."""
    move = each.section.pattern
    context = "".join(f", {name} {value:g}" for name, value in zip(by, move.context, strict=True))
    return f"{described(move)}{context}"


def verdict(sections: Sequence[SectionDrift], by: Sequence[str]) -> str:
    """Changes in one sentence, or that there were none and what was compared."""
    changed = [
        f"{_short(drift.name)} {_by(drift)} ({place(each, by)})"
        for each in sections
        for drift in each.drifts
        if drift.since is not None
    ]
    if changed:
        return f"changed: {'; '.join(changed)}{_warmer(sections)}"
    names = dict.fromkeys(_short(drift.name) for each in sections for drift in each.drifts)
    moves = "; ".join(place(each, by) for each in sections)
    return f"nothing changed beyond repeat scatter (compared: {', '.join(names)} of {moves})"


def _warmer(sections: Sequence[SectionDrift]) -> str:
    heat = max((each.heat for each in sections if each.may_be_heat), key=abs, default=0.0)
    if heat == 0.0:
        return ""
    way = "warmer" if heat > 0.0 else "colder"
    return f"; the axis was {abs(heat):.1f} K {way}, which may be all of it but for the load"


def sentences(each: SectionDrift, recordings: Sequence[str]) -> list[str]:
    """A line for each quantity, and one for the temperature."""
    return [*(_sentence(drift, each, recordings) for drift in each.drifts), _temperature(each)]


def _sentence(drift: Drift, each: SectionDrift, recordings: Sequence[str]) -> str:
    first = amount(drift.values[0], drift.changes[-1].unit)
    words = f"{_short(drift.name)}: {first} at first, change {estimate(drift.changes[-1])}"
    if drift.since is not None:
        heat = ", which the heat may explain" if _is_heat(drift, each) else ""
        return f"{words}: {_by(drift)} since {recordings[drift.since]}{heat}"
    between = [name for name, was in zip(recordings[1:], drift.changed, strict=True) if was]
    return f"{words}: {'only in ' + ', '.join(between) if between else 'within the scatter'}"


def _temperature(each: SectionDrift) -> str:
    if not math.isfinite(each.heat):
        return "temperature: not recorded, so heat cannot be told from wear"
    values = ", ".join(f"{value:.1f}" for value in each.temperature_c)
    return f"temperature: {values} °C"


def _is_heat(drift: Drift, each: SectionDrift) -> bool:
    return each.may_be_heat and drift.name not in _DEAF_TO_HEAT


def _by(drift: Drift) -> str:
    """Size of a change: a share where the first value is no smaller than the change."""
    change = drift.changes[-1]
    if math.isfinite(drift.relative) and abs(drift.relative) <= 1.0:
        return f"{100.0 * drift.relative:+.1f} %"
    return f"{'+' if change.value > 0.0 else ''}{amount(change.value, change.unit)}"


def _short(name: str) -> str:
    return name.rpartition("_")[0].replace("_", " ")
