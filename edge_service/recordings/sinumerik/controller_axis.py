"""Conversion of a controller's units to the channels of one axis."""

import math
from dataclasses import dataclass

from ...messages.channels import CHANNELS
from ...messages.units import SI

_SI = SI | {"A": (1.0, "A")}
"""Unit of a controller -> factor to SI, SI unit."""


@dataclass(frozen=True, slots=True)
class ControllerAxis:
    """Axis of a controller's recording that is wanted, and what turns its signals into channels.

    Attributes:
        number: the controller's number of the axis; None takes the only one there.
        lead_m: table travel per revolution of the screw, m. Controllers give the rotary encoder in
            mm of table travel, so without it there is no motor angle.
        torque_constant_nm_per_a: N m per A of torque-producing current; without it a current is
            no torque.
        interpolate_positions: draw positions of a slower clock as straight lines between their
            samples instead of holding them.
    """

    number: int | None = None
    lead_m: float | None = None
    torque_constant_nm_per_a: float | None = None
    interpolate_positions: bool = False

    def scale(self, channel: str, unit: str) -> float | None:
        """Factor from `unit` to the unit of `channel`; None where this axis cannot tell it."""
        factor, si_unit = _SI[unit]
        wanted = CHANNELS[channel].unit
        if si_unit == wanted:
            return factor
        link = self._links().get((si_unit, wanted))
        return None if link is None else factor * link

    def link(self, channel: str, unit: str) -> str:
        """Basis of `scale` beside the unit, in words; empty where there is none."""
        link = (_SI[unit][1], CHANNELS[channel].unit)
        if link == ("A", "N m"):
            return f"a torque constant of {self.torque_constant_nm_per_a} N m/A"
        return f"a lead of {self.lead_m} m" if link in self._links() else ""

    def missing(self, channel: str, unit: str) -> str:
        """Information that `scale` lacks, in words."""
        link = (_SI[unit][1], CHANNELS[channel].unit)
        if link == ("A", "N m"):
            return "the torque constant in N m/A"
        return "the lead of the screw" if link in self._links() else f"{unit} is no unit of it"

    def _links(self) -> dict[tuple[str, str], float | None]:
        rad_per_m = None if self.lead_m is None else 2.0 * math.pi / self.lead_m
        return {
            ("m", "rad"): rad_per_m,
            ("m/s", "rad/s"): rad_per_m,
            ("A", "N m"): self.torque_constant_nm_per_a,
        }
