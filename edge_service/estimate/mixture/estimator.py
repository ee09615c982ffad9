"""Preload estimator from drag and stretch, over the hypotheses of what happened to the axis."""

import math
from dataclasses import dataclass
from typing import Any

from ...messages.estimate import EstimateStatus, PreloadEstimate
from ...messages.features import Fault, FeatureBlock, Phase
from ...messages.interval import Interval
from ...messages.stored import Number, Stored
from ...models.machine import Machine
from ...models.steady_limits import LONGEST_HOLD_S
from ..validity import Validity
from . import state
from .gathering import SteadyInterval, gathered, interval_snapshot, restored_interval
from .hypotheses import continue_after_stop, initial_bank, leader_of
from .model import axis_model, process_of, start_of
from .posterior import fault_limits, posterior_of
from .state import MixtureSettings, Reading, bank_snapshot, restored_bank
from .step import step

_SNAPSHOT_SCHEMA = "mixture-preload/11"
VIBRATING_SHARE = 0.25
SHORTEST_S = (0.01, 0.0, 0.01)  # less is about the window through which acceleration is seen
SESSION_S = 600.0
"""An axis that was not seen to move for this long may have another load, lubricant or nut."""
FORCED_REPORTED_S = 5.0
WORST = 1000.0
"""Cap on an interval's normalised innovation squared while model and data disagree."""
WILDEST = (1e4, 1e6, 1e4)
"""Torque N m, acceleration rad/s^2, speed rad/s that no axis has."""
FURTHEST_M, FURTHEST_APART_M = 1e4, 5e-3
"""No axis is longer, nor is its encoders' difference, nor changes that as much between phases."""
SHIFTED_M = 1e-3
"""Standard deviation of the level of a linear encoder that has come back."""
INERTIA_SEEN_NM2_S, INERTIA_OFF = 0.01, 0.13
"""From how much acceleration, and from which share off, torque and motion contradict each other."""
RAPID_SEEN_S, RAPID_FORCED = 5.0, 0.6
"""From how much rapid motion, and from which share of it under a force, no model fits."""
_MOST_FRICTION, _MOST_LOAD = 2.5, 5.0
SLOWER = 1.5
"""Factor on commissioning's time between samples, beyond which its noise says nothing."""


@dataclass(slots=True)
class _Last:
    """End of the last interval, s, its stretch, m, and its normalised innovation squared."""

    last_s: float | None = None
    stretch_m: float | None = None
    nis: Number = math.nan


_STORED: Stored[_Last] = Stored(_Last)


class MixturePreloadEstimator:
    """Preload and drag of one commissioned axis (see interface.PreloadEstimator)."""

    def __init__(self, machine: Machine, settings: MixtureSettings = state.ASSUMED) -> None:
        assert machine.commissioned is not None
        self._settings, self._machine = settings, machine
        self._model = axis_model(machine)
        self._start = start_of(machine, self._model, self._settings)
        self.process = process_of(machine, self._model, self._start, self._settings)
        self._limits = fault_limits(machine, self._model, self._settings)
        self._known = None
        if machine.effects:
            from ..effect_compensation import EffectCompensation  # 25 ms that most do without

            self._known = EffectCompensation.of_machine(machine)
        known_s = machine.commissioned.sample_period_s or 0.0
        self._slowest_s = max(SLOWER * known_s, LONGEST_HOLD_S)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._validity = Validity(worst=WORST)
        self._bank, self._last = initial_bank(self._start, self._settings), _Last()
        self._waiting: SteadyInterval | None = None
        self._slow_s: float | None = None
        """Time between the samples of the last interval if that was too long to be read, s."""

    def interrupt(self) -> None:
        """Withdraw the number until motion comes: no data for longer than a number may stand."""
        self._validity.interrupt()

    def resume(self, stopped_s: float) -> None:
        """Continue after an unobserved stop, on a clock of its own.

        Friction may be anything, the screw has grown, the load may be another; the
        preload may have worn, and even the nut may be another.
        """
        self._validity.interrupt()
        self._last.last_s, self._last.stretch_m, self._waiting = None, None, None
        continue_after_stop(self._bank, self._start, max(stopped_s, 0.0))

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""
        if Fault.TABLE_SHIFTED in block.fault and Fault.NO_TABLE not in block.fault:
            self._last.stretch_m = None
            if self._bank.mean.shape[1] > state.TORQUE_STATES:
                self._bank.covariance[:, state.ENCODER_OFFSET, state.ENCODER_OFFSET] += SHIFTED_M**2
        calm, used_s = [], 0.0
        period_s = block.duration_s / max(block.sample_count, 1)
        too_slow = block.usable and period_s > self._slowest_s
        self._slow_s = period_s if too_slow else None
        done, self._waiting = ([], self._waiting) if too_slow else gathered(self._waiting, block)
        for interval in done:
            pairs = zip(interval.phases, SHORTEST_S, strict=True)
            phases = [phase for phase, least_s in pairs if phase.steady_s > least_s]
            taken = [] if vibrates(interval) else [self._take(interval, each) for each in phases]
            surprises = [surprise for surprise in taken if not math.isnan(surprise)]
            used_s += interval.duration_s if surprises else 0.0
            calm += surprises
        self._validity.update(block, bool(calm), max(calm, default=None), used_s)

    def _take(self, interval: SteadyInterval, phase: Phase) -> float:
        if self._known is not None:
            phase = self._known.compensated(phase, interval.direction, interval.time_s)
        reading = self._reading(interval, phase)
        if not plausible(reading):
            return math.nan
        last_s = self._last.last_s
        elapsed_s = interval.duration_s if last_s is None else interval.time_s - last_s
        if elapsed_s > SESSION_S:
            continue_after_stop(self._bank, self._start, elapsed_s)
            elapsed_s = interval.duration_s
        self._last.last_s = interval.time_s
        nis = step(self._bank, self._model, self.process, reading, max(elapsed_s, 0.0))
        if not math.isnan(nis):
            self._last.nis = nis
        return nis

    def _reading(self, interval: SteadyInterval, phase: Phase) -> Reading:
        """Phase as measured; without a stretch where no axis can have moved from the one before."""
        ratio, last = self._model.ratio_m_per_rad, self._last
        stretch, torque = math.nan, phase.torque_nm
        if self._model.compliance_m_per_n > 0.0:
            seen = ratio * phase.angle_rad - phase.table_m
            if abs(seen) <= FURTHEST_M and (
                last.stretch_m is None or abs(seen - last.stretch_m) <= FURTHEST_APART_M
            ):
                stretch = last.stretch_m = seen
        if not math.isnan(interval.external_force_n):
            torque += ratio * interval.external_force_n
            stretch += self._model.compliance_m_per_n * interval.external_force_n
        begin_s = interval.time_s - interval.duration_s
        follows = last.last_s is not None and abs(begin_s - last.last_s) < 0.1 * interval.duration_s
        motion = (phase.acceleration_rad_s2, phase.speed_rad_s, phase.table_m)
        return Reading(phase.steady_s, interval.direction, torque, *motion, stretch, follows)

    def estimate(self) -> PreloadEstimate:
        """Estimate after the last interval."""
        status, reasons = self._validity.status()
        if status is EstimateStatus.ESTIMATED and (doubt := self._implausible()):
            status, reasons = EstimateStatus.INVALID, (doubt, *reasons)
        unread = self._unread()
        why = unread or self._forced()
        if status is EstimateStatus.INSUFFICIENT_EXCITATION and why:
            reasons = (why, *(each for each in reasons if not each.startswith("no_motion:")))
            status = EstimateStatus.UNESTIMATED if unread else status
        common = self._validity.told("mixture", status)
        if status is not EstimateStatus.ESTIMATED:
            return PreloadEstimate(**common, reasons=reasons)
        if self._known is not None and self._known.left:
            left = f"effects_left: {', '.join(self._known.left)} of the machine file"
            reasons = (*reasons, f"{left}: the estimate follows these by itself")
        rating = self._machine.axis.dynamic_load_rating_n
        assert rating is not None
        limits = self._limits._replace(widening=self._validity.widening)
        posterior = posterior_of(self._bank, self._model, limits)
        percent, low, high = posterior.preload
        return PreloadEstimate(
            **common,
            reasons=reasons,
            preload_percent=percent,
            low=low,
            high=high,
            preload_n=percent / 100.0 * rating,
            drag_torque_nm=_interval(posterior.drag),
            stiffness_n_per_m=_interval(posterior.stiffness),
            mode_probability=posterior.levels,
            fault_probability=posterior.faults,
            nis=self._last.nis,
        )

    def _unread(self) -> str | None:
        """Reason why samples as slow as the last are not read; None if they are."""
        if self._slow_s is None:
            return None
        known_s = self._machine.commissioned and self._machine.commissioned.sample_period_s
        known = f"{1.0 / known_s:.4g}" if known_s else f"more than {1.0 / LONGEST_HOLD_S:.3g}"
        return (
            f"too_slow: {1.0 / self._slow_s:.3g} samples/s, commissioned at {known}: how the "
            "torque goes on in between is not known; commission from recordings of this source"
        )

    def _forced(self) -> str | None:
        """Reason why the motion seen corrects nothing; None if it does."""
        if self._bank.moments[state.FORCED_S] < FORCED_REPORTED_S:
            return None
        return (
            "process_force: a force has acted on the table in all recent motion; needs rapids or "
            "moves without cutting; if nothing was cut, run `edge-service doctor`: a signal may lag"
        )

    def _implausible(self) -> str | None:
        """Reason why no axis can be as the leading hypothesis says; None if one can."""
        bank, model, moments = self._bank, self._model, self._bank.moments
        mean = bank.mean[leader_of(bank)]
        if moments[state.INERTIA_TORQUE] > INERTIA_SEEN_NM2_S:
            off = float(moments[state.INERTIA_ERROR] / moments[state.INERTIA_TORQUE])
            off -= float(mean[state.PAYLOAD]) * model.ratio_m_per_rad**2 / model.inertia_kg_m2
            if abs(off) > INERTIA_OFF:
                return (
                    f"model_mismatch: accelerating takes {100 * (1 + off):.0f} % of the torque "
                    "that it took at commissioning, even allowing for payload: check torque "
                    "constant, inertia, lead and units"
                )
        if moments[state.RAPID_S] > RAPID_SEEN_S:
            forced = float(moments[state.RAPID_FORCED_S] / moments[state.RAPID_S])
            if forced > RAPID_FORCED:
                return (
                    f"model_mismatch: no preload explains {100 * forced:.0f} % of the rapids: a "
                    "force would act there, where nothing cuts; check encoders, load and machine "
                    "file, or run `edge-service diagnose`"
                )
        friction = float(max(mean[state.NUT_FRICTION : state.GUIDE_VISCOUS + 1]))
        load_kg = model.table_mass_kg if len(mean) > state.TORQUE_STATES else math.inf
        for name, value, low, high in (
            ("friction", friction, -1.0, _MOST_FRICTION),
            ("torque", float(mean[state.TORQUE_SCALE]), -INERTIA_OFF, INERTIA_OFF),
            ("payload", float(mean[state.PAYLOAD]), -0.8 * load_kg, _MOST_LOAD * load_kg),
        ):
            if not low <= value <= high:
                return (
                    f"model_mismatch: {name} would be off by {value:.3g}, expected {low:.3g} to "
                    f"{high:.3g}: check torque constant, lead, signs and units"
                )
        return None

    def snapshot(self) -> dict[str, Any]:
        """The whole state as JSON-able values."""
        return {
            "schema": _SNAPSHOT_SCHEMA,
            "validity": self._validity.snapshot(),
            "bank": bank_snapshot(self._bank),
            "gathering": interval_snapshot(self._waiting),
            **_STORED.dump(self._last),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot; ValueError if it is none of this axis', and nothing is changed."""
        if snapshot.get("schema") != _SNAPSHOT_SCHEMA:
            raise ValueError(f"no {_SNAPSHOT_SCHEMA} snapshot")
        try:
            bank = restored_bank(snapshot["bank"], self._bank)
            waiting = restored_interval(snapshot["gathering"])
            validity = Validity(worst=WORST)
            validity.restore(snapshot["validity"])
        except (KeyError, TypeError, AttributeError) as error:
            raise ValueError(f"a damaged snapshot: {error!r}") from error
        self._last = _STORED.load(snapshot)
        self._bank, self._waiting, self._validity = bank, waiting, validity


def _interval(bounds: tuple[float, float, float] | None) -> Interval | None:
    return None if bounds is None else Interval(value=bounds[0], low=bounds[1], high=bounds[2])


def vibrates(interval: SteadyInterval) -> bool:
    """A process shakes the axis: it speeds up and slows down for much of one interval."""
    steady_s = sum(phase.steady_s for phase in interval.phases)
    shaken_s = min(interval.phases[0].steady_s, interval.phases[-1].steady_s)
    return shaken_s > VIBRATING_SHARE * steady_s and shaken_s > 0.0


def plausible(reading: Reading) -> bool:
    """An axis can move as a phase says."""
    motion = (reading.torque_nm, reading.acceleration_rad_s2, reading.speed_rad_s)
    is_far = abs(reading.table_m) > FURTHEST_M  # NaN, without a linear encoder, is not
    within = all(abs(value) <= most for value, most in zip(motion, WILDEST, strict=True))
    return within and not is_far
