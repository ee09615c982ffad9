"""Answers that the recordings of an axis allow, and the motion that would allow the others."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..messages.channels import ANGLE, TABLE_POSITION, TORQUE
from .guess import Choice
from .mechanics import Mechanics

_RESPONSE_HZ = 200.0


@dataclass(frozen=True, slots=True)
class Ability:
    """One thing that a user asks for.

    Attributes:
        what: in the user's words.
        reason: why not; empty if it can be answered.
        motion: of `edge-service motion`, which would answer it; empty if none would.
    """

    what: str
    reason: str
    motion: str = ""

    def as_text(self) -> str:
        """One line."""
        if not self.reason:
            return f"{self.what}: yes"
        remedy = f"; record `edge-service motion {self.motion}`" if self.motion else ""
        return f"{self.what}: no, {self.reason}{remedy}"


def abilities(
    columns: Mapping[str, Choice], mechanics: Mechanics | None, rate_hz: float, *, has_rating: bool
) -> list[Ability]:
    """Answers that these recordings allow or not, in the order in which people ask."""
    return [
        Ability("friction and its change", *_friction(columns, mechanics)),
        Ability("inertia", *_inertia(columns, mechanics)),
        Ability("preload in percent", *_preload(columns, mechanics, has_rating)),
        Ability("stretch, play and stiffness between two encoders", *_stretch(columns)),
        Ability("frequency response, if the motion shakes the axis", *_response(columns, rate_hz)),
    ]


def _friction(columns: Mapping[str, Choice], mechanics: Mechanics | None) -> tuple[str, str]:
    if TORQUE not in columns:
        return "no column is known as a torque in N m", ""
    if mechanics is None:
        return "the travel per revolution is unknown, or too little moves", ""
    if not mechanics.coulomb.determined:
        return "too little steady motion both ways", "friction"
    if mechanics.coulomb.low <= 0.0:
        return "it is not told from none", "friction"
    return "", ""


def _inertia(columns: Mapping[str, Choice], mechanics: Mechanics | None) -> tuple[str, str]:
    if TORQUE not in columns:
        return "no column is known as a torque in N m", ""
    if columns[TORQUE].direction:
        return "a torque without a sign is wrong while the axis brakes", ""
    if mechanics is None:
        return "the travel per revolution is unknown, or too little moves", ""
    if not mechanics.inertia.determined:
        return mechanics.inertia.note, ""
    if mechanics.inertia.low <= 0.0:
        return "too little acceleration", "acceleration"
    return "", ""


def _preload(
    columns: Mapping[str, Choice], mechanics: Mechanics | None, has_rating: bool
) -> tuple[str, str]:
    why, motion = _friction(columns, mechanics)
    if why:
        return why, motion
    if not has_rating:
        return "dynamic_load_rating_n and preload_n of the data sheet are missing", ""
    return "the machine file is not commissioned yet (`edge-service commission`)", "production"


def _stretch(columns: Mapping[str, Choice]) -> tuple[str, str]:
    missing = [name for name in (ANGLE, TABLE_POSITION) if name not in columns]
    if missing:
        return f"there is no {' and no '.join(missing)}", ""
    return "the ends of travel are unknown: set axis.stroke_m in the machine file", "acceleration"


def _response(columns: Mapping[str, Choice], rate_hz: float) -> tuple[str, str]:
    if TORQUE not in columns:
        return "no column is known as a torque in N m", ""
    if rate_hz < _RESPONSE_HZ:
        return f"{rate_hz:.3g} samples/s are too few", ""
    return "", ""
