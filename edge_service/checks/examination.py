"""Examination of recordings: every check that holds them against the machine file and each other.

Commands that learn from a recording or judge it ask this before they answer; `doctor` prints it.
Every finding is a number with an interval, held against the machine file, in one sentence.
"""

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files

import numpy as np

from ..messages.samples import SampleFrame
from ..models.machine import Machine
from . import positions, signals, torque
from .finding import Finding, Verdict

SLACK_S = 1.0
"""Shorter halves of a recording are not asked whether they show a mistake as well."""


@dataclass(frozen=True, slots=True)
class Check:
    """One entry of the registry."""

    run: Callable[[Machine, positions.Recordings], Finding]
    compared: str  # what is held against what
    remedy: str  # what to do where it doubts
    needed: Sequence[str] = ()  # channels without which there is nothing to check

    @property
    def name(self) -> str:
        return self.run.__name__.removeprefix("check_")


_RUN = {**vars(signals), **vars(positions), **vars(torque)}
_TABLE = tomllib.loads((files(__package__) / "examination.toml").read_text("utf-8"))
CHECKS = tuple(Check(_RUN[f"check_{name}"], **words) for name, words in _TABLE.items())
"""Checks in the order in which they are told: what spoils the others comes first."""


def check_plausibility(
    machine: Machine, recordings: Sequence[SampleFrame], unread: Sequence[str] | None = None
) -> list[Finding]:
    """Every check that the channels of one axis allow, in a fixed order.

    `unread` are columns of the files that are no channel; None where there are no files.
    """
    channels = {name for frame in recordings for name in frame.channels}
    found = [] if unread is None else [signals.check_columns(channels, unread)]
    has_limits = bool(machine.axis.max_speed_rad_s or machine.axis.max_torque_nm)
    known, able = positions.Recordings(recordings), [c for c in CHECKS if channels >= {*c.needed}]
    found += [_lasting(check, machine, known) for check in able]
    return [each for each in found if each.name != "limits" or has_limits or each.is_doubtful]


def _lasting(check: Check, machine: Machine, recordings: positions.Recordings) -> Finding:
    """Finding of a check; a mistake of unit or sign is in the first half and in the second.

    What comes or goes in between is a fault of the machine or of a sensor, and for the answer.
    """
    found = _judged(check, machine, recordings)
    if not found.forbids:
        return found
    long = [frame for frame in recordings if np.ptp(frame.time_s) > 2.0 * SLACK_S]
    first = positions.Recordings(frame.part(slice(0, len(frame) // 2)) for frame in long)
    second = positions.Recordings(frame.part(slice(len(frame) // 2, None)) for frame in long)
    halves = [_judged(check, machine, half).verdict for half in (first, second) if half]
    return replace(found, forbids=Verdict.FITS not in halves)


def _judged(check: Check, machine: Machine, recordings: positions.Recordings) -> Finding:
    try:
        found = check.run(machine, recordings)
    except ValueError as error:
        found = Finding(check.name, Verdict.UNKNOWN, f"cannot tell: {' '.join(str(error).split())}")
    remedy = check.remedy if found.is_doubtful and not found.remedy else found.remedy
    return replace(found, name=check.name, compared=check.compared, remedy=remedy)
