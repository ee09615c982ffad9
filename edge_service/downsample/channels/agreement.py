"""Agreement of the linear encoder with the way of the screw, within the limits of a sound axis."""

from dataclasses import astuple, dataclass, field
from typing import Annotated

import numpy as np

from ...messages.samples import Floats
from ...messages.stored import Packed
from . import agreement_kernels as kernels
from .channel_limits import GROWTH_PER_LENGTH_S, MOST_GROWTH, ChannelLimits

_ANCHORS = ("held", "rest", "begun", "newest")


@dataclass(frozen=True, slots=True)
class Chunk:
    """Means over a few rows, as stored.

    Attributes:
        parted_m: way of the screw less that of the table, less the skew that is known.
        way_m: of the screw.
    """

    time_s: float
    parted_m: float
    way_m: float
    speed_m_s: float
    torque_nm: float


@dataclass(frozen=True, slots=True)
class Roughness:
    """Contribution of the channels themselves to the parting of the encoders.

    Attributes:
        noise_m: of their difference from row to row.
        lag_s: longest for which a slow channel holds a value.
        span_nm: between the least and the largest torque around the interval.
    """

    noise_m: float = 0.0
    lag_s: float = 0.0
    span_nm: float = np.nan

    @property
    def numbers(self) -> Floats:
        """The numbers as the arithmetic takes them, (3,)."""
        return np.array([self.noise_m, self.lag_s, self.span_nm])


@dataclass(slots=True)
class Contact:
    """Contact of the nut: pushing the table with the same flank all the while, or not.

    Attributes:
        pushed_from_m: way of the screw at which it began to push; NaN while it does not.
    """

    direction: float = 0.0
    speed_m_s: float = np.nan
    time_s: float = np.nan
    pushed_from_m: float = np.nan


@dataclass(slots=True)
class AgreementState:
    """Everything on which the next piece is compared, as stored; see Agreement.

    Attributes:
        contact: of the nut.
        closed: no play can hide between the encoders.
        anchors: earlier pieces by name.
    """

    contact: Annotated[Contact, Packed()] = field(default_factory=Contact)
    closed: bool = False
    anchors: dict[str, Annotated[Chunk, Packed()]] = field(default_factory=dict)


class Agreement:
    """Comparison of both encoders with earlier pieces at which they agreed.

    `held` is the last piece of pushed motion, `rest` the last one at rest: a reversal may add the
    play to them. `begun` is where the present push began and `newest` its last piece: nothing may
    be added to them but what goes with way, torque and speed.
    """

    def __init__(self, limits: ChannelLimits, state: AgreementState | None = None) -> None:
        self._limits = _numbers_of(limits)
        self.restore(state or AgreementState())

    def forget(self) -> None:
        """Forget all earlier pieces."""
        self.restore(AgreementState())

    def interrupt(self) -> None:
        """Take a gap: the present push may have ended."""
        self._contact = np.array([*astuple(Contact()), 0.0])
        self._anchors[[kernels.BEGUN, kernels.NEWEST]] = np.nan

    @property
    def closed(self) -> bool:
        """True while no play can hide between the encoders."""
        return bool(self._contact[kernels.CLOSED])

    def parted_m(self, pieces: Floats, rough: Roughness) -> float:
        """Take the next pieces (k, 5), see `agreement_kernels`; the parting of the encoders
        beyond a sound axis' limits at the first that does, m, or 0."""
        numbers = rough.numbers
        return kernels.parted_m(pieces, self._contact, self._anchors, self._limits, numbers)

    def is_elsewhere(self, piece: Floats, rough: Roughness) -> bool:
        """True if a piece lies at another level than the last that agreed."""
        return kernels.is_elsewhere(piece, self._anchors, self._limits, rough.numbers)

    @property
    def state(self) -> AgreementState:
        """Everything on which the next piece is compared."""
        rows = zip(_ANCHORS, self._anchors.tolist(), strict=True)
        anchors = {name: Chunk(*row) for name, row in rows if not np.isnan(row[0])}
        return AgreementState(Contact(*self._contact[:-1].tolist()), self.closed, anchors)

    def restore(self, state: AgreementState) -> None:
        """Continue from a state."""
        self._contact = np.array([*astuple(state.contact), float(state.closed)])
        self._anchors = np.full((len(_ANCHORS), 5), np.nan)
        for row, name in enumerate(_ANCHORS):
            if name in state.anchors:
                self._anchors[row] = astuple(state.anchors[name])


def _numbers_of(limits: ChannelLimits) -> Floats:
    """Limits as the arithmetic takes them."""
    stretch = limits.stretch_m(1.0)
    first = (limits.ratio_m_per_rad, limits.play_m, limits.periodic_m, limits.compliance_m_per_n)
    rest = (limits.length_m, limits.skew_s, stretch, GROWTH_PER_LENGTH_S, MOST_GROWTH)
    return np.array([*first, *rest])
