"""Credibility of torque, motor angle and linear encoder, from interval to interval.

A channel that fails is doubted at once; the linear encoder is believed again after it has followed
the screw for a while, and its level counts as new then.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from ...messages.features import FAULT_WORDS, Fault
from ...messages.row_faults import THETA, T, U, X
from ...messages.samples import Floats
from ...messages.stored import Number, StoredFloats
from .channel_limits import ChannelLimits
from .encoder_agreement import CLOSED, SPEED, Agreement, measured, parted_m
from .repeats import FORGET, OpenRun, followed, holds

TRIAL_S = 1.0
"""Motion for which the encoders have to agree again, and a turn of the screw in it: ten times
what the detection of a fault needs, and every error periodic in a turn has shown itself."""
LONG_TRIAL_S = 64.0
AS_FAST = 0.8  # of the speed at which the encoders parted; a trial reaches it both ways
SETTLED_S = 60.0  # a fault within so much motion after a trial makes the next one long
LOST_S = 1.0  # a channel that was missing for longer may have been reset
_SMOOTH = 1.0 / 16.0  # of the noise of the last interval
LONGER = 1.5
"""Factor on the hold of a channel at commissioning from which on its lag is another."""
_HELD = (Fault.TORQUE_HELD, Fault.ANGLE_HELD, Fault.TABLE_HELD)
_OF_ALL = Fault.TORQUE_STUCK | Fault.NO_TORQUE | Fault.TORQUE_OUTLIERS | Fault.TORQUE_HELD
_OF_ALL |= Fault.ANGLE_STUCK | Fault.NO_POSITION | Fault.ANGLE_OUTLIERS | Fault.ANGLE_HELD
_OF_ALL |= Fault.TABLE_OUTLIERS
WITHOUT_TABLE = Fault.TABLE_STUCK | Fault.TABLE_DISAGREES | Fault.TABLE_DOUBTED | Fault.TABLE_HELD
_MISSING_CODES = {
    Fault.NO_TORQUE: "torque_missing",
    Fault.NO_POSITION: "angle_missing",
    Fault.NO_TABLE: "table_missing",
}


@lru_cache(256)
def channel_reasons(fault: Fault) -> tuple[str, ...]:
    """Caveats on the channels of an interval; for the table, the first that keeps it out."""
    without = (list(fault & WITHOUT_TABLE) or list(fault & Fault.NO_TABLE))[:1]
    return tuple(
        f"{_MISSING_CODES.get(kind, str(kind.name).lower())}: {FAULT_WORDS[kind]}"
        + ("; preload from torque alone" if kind in without else "")
        for kind in (*(fault & _OF_ALL), *without, *(fault & Fault.TABLE_SHIFTED))
    )


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on an interval: its faults, and the channels that may be read."""

    fault: Fault  # bits of Fault
    has_table: bool  # the linear encoder may be read
    has_stretch: bool  # both encoders may be compared in the phases


@dataclass(slots=True)
class _Trial:
    """Progress of a doubted encoder's trial. `needed_s` is 0 while it is believed."""

    needed_s: float = 0.0
    agreed_s: float = 0.0
    way_m: float = 0.0
    # parted_m_s: speed of parting; ahead_m_s, back_m_s: greatest of agreement since, either way
    parted_m_s: float = 0.0
    ahead_m_s: float = 0.0
    back_m_s: float = 0.0
    since_s: Number = np.inf  # motion since it was passed
    missing_s: float = 0.0  # without a value
    elsewhere: bool = False  # agrees, at another level
    returned: bool = False  # passed, and not reported yet

    @property
    def doubted(self) -> bool:
        return self.needed_s > 0.0

    def begin(self, speed_m_s: float) -> None:
        """Doubt the encoder; after a relapse it has to agree for long."""
        if not self.doubted:
            relapsed = self.since_s < SETTLED_S
            self.needed_s = LONG_TRIAL_S if relapsed else TRIAL_S
        self.agreed_s, self.way_m, self.elsewhere = 0.0, 0.0, False
        self.parted_m_s = max(self.parted_m_s, speed_m_s)
        self.ahead_m_s = self.back_m_s = 0.0

    def follow(self, moved_s: float, way_m: float, turn_m: float, speeds_m_s: Floats) -> None:
        """Take motion in which the encoders agreed; at an even speed a lag is a mere offset."""
        if not self.doubted:
            self.since_s += moved_s
            return
        self.agreed_s += moved_s
        self.way_m += way_m
        self.ahead_m_s = max(self.ahead_m_s, float(speeds_m_s.max()))
        self.back_m_s = max(self.back_m_s, -float(speeds_m_s.min()))
        is_told = min(self.ahead_m_s, self.back_m_s) >= AS_FAST * self.parted_m_s
        if is_told and self.agreed_s >= self.needed_s and self.way_m >= turn_m:
            self.needed_s, self.parted_m_s, self.since_s, self.returned = 0.0, 0.0, 0.0, True


@dataclass(slots=True, eq=False)
class ChannelState:
    """Everything on which the next interval is checked."""

    # of the encoders; `level` is that before the linear one was doubted
    agreement: Agreement = field(default_factory=Agreement)
    level: Agreement = field(default_factory=Agreement)
    noise_m: Number = 0.0  # of the difference between the encoders from row to row
    trial: _Trial = field(default_factory=_Trial)
    # table_run, angle_run: of a repeated value, in which the channels end
    table_run: OpenRun = field(default_factory=OpenRun)
    angle_run: OpenRun = field(default_factory=OpenRun)
    # least and most of the interval before, and the value at which it is stuck, (3,)
    torque_nm: StoredFloats = field(default_factory=lambda: np.full(3, np.nan))
    # least_step, hold_s: of torque, motor angle and table: least step from row to row, in their
    # units; time for which they repeat a value, s; leaps, repeats: how often that; (3,) each
    least_step: StoredFloats = field(default_factory=lambda: np.full(3, np.nan))
    hold_s: StoredFloats = field(default_factory=lambda: np.zeros(3))
    leaps: StoredFloats = field(default_factory=lambda: np.zeros(3))
    repeats: StoredFloats = field(default_factory=lambda: np.zeros(3))
    grid: StoredFloats = field(default_factory=lambda: np.zeros(3))  # resolution, in their units


class ChannelCheck:
    """Check of the channels of one axis against the limits of a sound one.

    Attributes:
        state: a new one begins anew, as on a new clock.
    """

    def __init__(self, limits: ChannelLimits, fastest_rad_s: float) -> None:
        self._limits = limits
        first = (limits.ratio_m_per_rad, limits.play_m, limits.periodic_m)
        self._numbers = np.array([*first, limits.length_m, limits.stretch_m(1.0), limits.skew_s])
        self._fastest_rad_s = fastest_rad_s
        self.state = ChannelState()

    def interrupt(self) -> None:
        """Take a gap: nothing that continues from row to row is known."""
        self.state.agreement.interrupt()
        self.state.angle_run = OpenRun()

    def torque_stays(self, torque: Floats, stuck: bool) -> bool:
        """Flag of a torque (n,) that continues with the value that it was stuck at."""
        known_nm = self.state.torque_nm
        goes_on = bool(torque[0] == known_nm[2])
        whole = goes_on and bool((torque == torque[0]).all())
        known_nm[2] = torque[-1] if stuck or whole else np.nan
        return goes_on

    def check(self, inside: Floats, ahead: Floats) -> Verdict:
        """Check the channels of an interval.

        Args:
            inside: (n + 1, 8), the last row begins the next interval.
            ahead: (m, 8), rows after these that are known already.
        """
        held_longer, verdict = self._held_longer(inside), self._check_positions(inside, ahead)
        if Fault.TABLE_HELD in held_longer:
            return Verdict(verdict.fault | held_longer | Fault.NO_TABLE, False, False)
        return replace(verdict, fault=verdict.fault | held_longer) if held_longer else verdict

    def _held_longer(self, inside: Floats) -> Fault:
        """Channels that repeat values for longer than at commissioning, or are coarser."""
        fault, state, limits = Fault.NONE, self.state, self._limits
        period_s = float(inside[-1, T] - inside[0, T]) / (len(inside) - 1)
        known = state.least_step, state.leaps, state.repeats, state.grid
        hold_s = period_s * (holds(inside, *known) - 1.0)
        state.hold_s = np.maximum(hold_s, state.hold_s / FORGET)
        each = zip(_HELD, hold_s, limits.hold_s or (), state.grid, limits.coarsest, strict=False)
        for kind, now_s, usual_s, grid, most in each:
            if now_s > LONGER * usual_s + 0.5 * period_s or (usual_s == 0.0 and grid > most):
                fault |= kind
        return fault

    def _check_positions(self, inside: Floats, ahead: Floats) -> Verdict:
        state, table = self.state, inside[:, X]
        before, least, most = state.torque_nm.copy(), inside[:, U].min(), inside[:, U].max()
        state.torque_nm[:2] = least, most
        span_nm = float(np.fmax(most, before[1]) - np.fmin(least, before[0]))
        if np.isnan(table).any():
            return self._without_table(inside)
        state.trial.missing_s = 0.0
        return self._check_both(inside, ahead, span_nm)

    def _without_table(self, inside: Floats) -> Verdict:
        state, way = self.state, inside[:, THETA] * self._limits.ratio_m_per_rad
        known = np.flatnonzero(~np.isnan(inside[:-1, X]))
        if known.size:
            state.table_run = followed(inside[known][:, X], way[known], state.table_run)
        state.angle_run = OpenRun()
        state.agreement.interrupt()
        state.trial.missing_s += float(inside[-1, T] - inside[0, T])
        if state.trial.missing_s >= LOST_S:
            _doubt(state, 0.0)
        return Verdict(Fault.NONE, False, False)

    def _check_both(self, inside: Floats, ahead: Floats, span_nm: float) -> Verdict:
        state, limits, trial = self.state, self._limits, self.state.trial
        seen = measured(inside, ahead, self._numbers, state.table_run, state.angle_run)
        pieces, found, state.table_run, state.angle_run = seen
        fastest, speed_m_s, angle_m, table_m, open_m, noise_m, way_m, moving = found.tolist()
        if fastest > self._fastest_rad_s:
            state.agreement.interrupt()
            return _verdict(state.trial, Fault.NONE, has_stretch=False)
        period_s = float(inside[-1, T] - inside[0, T]) / (len(inside) - 1)
        steps_m = state.least_step[1] * limits.ratio_m_per_rad + state.least_step[2]
        lags_s = float(state.hold_s[1] + state.hold_s[2])
        resolution_m = 4.0 * (steps_m + (2.0 * period_s + lags_s) * speed_m_s)  # of one value
        stretch_m = limits.stretch_m(span_nm)
        coarse_m = resolution_m if np.isfinite(resolution_m) else 0.0
        if angle_m > limits.play_m + limits.growth_m + stretch_m + coarse_m:
            state.agreement.interrupt()
            return _verdict(state.trial, Fault.STUCK | Fault.ANGLE_STUCK, has_stretch=False)
        rough = np.array([state.noise_m, lags_s, span_nm])
        agreement, pushed = state.agreement, state.agreement.contact[CLOSED]
        apart_m = parted_m(pieces, agreement.contact, agreement.anchors, self._numbers, rough)
        hidden_m = stretch_m + (0.0 if pushed and agreement.contact[CLOSED] else limits.play_m)
        table_stands = table_m > max(hidden_m, limits.periodic_m) + coarse_m
        if table_stands or apart_m > 0.0:
            _doubt(state, float(np.sort(np.abs(pieces[:, SPEED]))[-2:][0]))  # one may be a leap
            stuck = table_stands or open_m > 0.5 * apart_m
            why = Fault.TABLE_STUCK if stuck else Fault.TABLE_DISAGREES
            return Verdict(why | Fault.NO_TABLE, False, False)
        suspect = max(angle_m, table_m) > resolution_m
        if not suspect:
            if trial.doubted and moving:
                trial.elsewhere = state.level.is_elsewhere(pieces[-1], self._numbers, rough)
            state.noise_m += _SMOOTH * (noise_m - state.noise_m)
            turn_m = 2.0 * np.pi * limits.ratio_m_per_rad
            moved_s = moving * float(inside[-1, T] - inside[0, T])
            trial.follow(moved_s, way_m, turn_m, pieces[:, SPEED])
        return _verdict(state.trial, Fault.NONE, has_stretch=not suspect)


def _doubt(state: ChannelState, speed_m_s: float) -> None:
    if not state.trial.doubted:
        state.level = state.agreement
    state.agreement = Agreement()
    state.trial.begin(speed_m_s)


def _verdict(trial: _Trial, fault: Fault, has_stretch: bool) -> Verdict:
    if trial.doubted:
        fault |= Fault.TABLE_SHIFTED if trial.elsewhere else Fault.NONE
        return Verdict(fault | Fault.NO_TABLE | Fault.TABLE_DOUBTED, False, False)
    if trial.returned:
        trial.returned = False
        fault |= Fault.TABLE_SHIFTED
    return Verdict(fault, True, has_stretch)
