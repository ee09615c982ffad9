"""Preload estimator of the thesis (section 4.5) on intervals of a closed-loop axis.

Five mode-matched filters at 10, 7.5, 5, 2.5 and 0 % of preload (KF or SIF), interacting by the
thesis' mode transition matrix; the preload is the weighted, smoothed sum of the levels (4.5.2 to
4.5.4). Two things differ from the thesis, because a machine runs in closed loop: the direction of
friction is that of the speed, and intervals in which the axis rests or turns round are left out
(the bank's mode probabilities rest with it: a screw does not wear while it stands still).
"""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from ...messages.estimate import EstimateStatus, Interval, PreloadEstimate
from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from ...messages.stored import Decimals, Number, Stored
from ...models.machine import Machine
from ..interface import EstimatorOptions
from ..validity import Validity, ValiditySettings
from .bank.engines import make_filter_bank
from .bank.mode_transition import LEVELS_PERCENT, THESIS_MODE_TRANSITION, scaled_mode_transition
from .drag import DragFilter, DragSettings
from .excitation import ExcitationSettings, informative
from .mode_weighting import mode_weights
from .momentum_balance import MomentumBalance, MomentumBalanceSettings

TWO_SIDED_95 = 1.959963984540054
BEYOND_LEVELS_PERCENT = 0.6
"""Scale on which drag beyond the highest or lowest level counts as a misfit, points."""
_SNAPSHOT_SCHEMA = "imm-preload/2"


@lru_cache(maxsize=256)
def _mode_transition(duration_s: float) -> Floats:
    """Mode transition matrix for an interval of another length, s."""
    return scaled_mode_transition(THESIS_MODE_TRANSITION, duration_s)


@dataclass(frozen=True, slots=True)
class ImmSettings:
    """Settings of the thesis' method.

    Attributes:
        method: `kf-imm` or `sif-imm`.
        engine: `compiled`, or `filterpy` (kf-imm only, slow).
        activation_exponent: exponent of thesis eq. 4.5.4; 1, 1.33 or 2 in the thesis.
        window_s: causal moving average of the mode probabilities over informative motion, s.
        sliding_boundary: delta of the sliding innovation filter for [rad, rad/s].
    """

    method: Literal["kf-imm", "sif-imm"] = "kf-imm"
    engine: Literal["compiled", "filterpy"] = "compiled"
    activation_exponent: float = 1.33
    window_s: float = 1.0
    sliding_boundary: tuple[float, float] = (0.05, 0.07)
    balance: MomentumBalanceSettings = field(default_factory=MomentumBalanceSettings)
    drag: DragSettings = field(default_factory=DragSettings)
    excitation: ExcitationSettings = field(default_factory=ExcitationSettings)
    validity: ValiditySettings = field(default_factory=ValiditySettings)


@dataclass(slots=True)
class _State:
    """Everything on which the next interval depends, but for drag filter, bank and validity.

    Attributes:
        probability: mode probabilities after the last interval, (r,).
        recent: durations, s, and mode probabilities within the window.
        last_end_s: end of the last informative interval, s.
        stopped_s: length of a stop before the next interval, s.
        nis: normalised innovation squared of the last step.
    """

    probability: Decimals
    recent: list[tuple[float, Decimals]] = field(default_factory=list)
    last_end_s: float | None = None
    stopped_s: float = 0.0
    nis: Number = float("nan")


_STORED: Stored[_State] = Stored(_State)


class ImmPreloadEstimator:
    """Preload and drag of one axis from its feature blocks (see interface.PreloadEstimator).

    Args:
        machine: the baseline model. Without load rating, preload or fresh drag there is no preload
            in percent, only drag.
        settings: the method.
    """

    def __init__(self, machine: Machine, settings: ImmSettings) -> None:
        self._machine = machine
        self._settings = settings
        self._levels = np.array(LEVELS_PERCENT)
        self._per_percent = machine.drag_per_percent_nm
        self._drag = DragFilter(machine, settings.drag)
        if self._per_percent is not None:
            self._balance = MomentumBalance(
                machine, self._levels * self._per_percent, settings.balance
            )
            self._bank = make_filter_bank(
                settings.method, settings.engine, boundary=np.array(settings.sliding_boundary)
            )
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._drag.reset()
        if self._per_percent is not None:
            self._bank.restore({})
        self._validity = Validity(self._settings.validity, self._settings.excitation.hold_s)
        self._now = _State(np.full(len(self._levels), 1.0 / len(self._levels)))

    def interrupt(self) -> None:
        """Withdraw the number until motion comes: no data for longer than a number may stand."""
        self._validity.interrupt()

    def resume(self, stopped_s: float) -> None:
        """Continue after an unobserved stop, on a clock of its own: the drag has wandered."""
        self._validity.interrupt()
        self._now.recent.clear()
        self._now.last_end_s, self._now.stopped_s = None, max(stopped_s, 0.0)

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""
        used = informative(block, self._settings.excitation)
        if used:
            self._drag.update(block, self._since_last(block))
            if self._per_percent is not None:
                self._step_bank(block)
            self._now.last_end_s, self._now.stopped_s = block.time_s, 0.0
        self._validity.update(block, used, self._surprise() if used else None)

    def _surprise(self) -> float:
        """Lack of fit of the best level: about 1 is expected, much more is a misfit."""
        drag, sigma = self._drag.drag_nm, self._drag.sigma_nm
        if self._per_percent is None:
            return max(0.0, -drag / sigma) ** 2 if sigma > 0.0 else 0.0
        percent = self._direct_percent(self._per_percent)
        beyond = percent - min(max(percent, min(LEVELS_PERCENT)), max(LEVELS_PERCENT))
        return max(self._now.nis, (beyond / BEYOND_LEVELS_PERCENT) ** 2)

    def _direct_percent(self, per_percent: float) -> float:
        """Preload that the drag filter's drag stands for, percent."""
        return (self._drag.drag_nm - self._machine.other_drag_nm.value) / per_percent

    def _since_last(self, block: FeatureBlock) -> float:
        if self._now.last_end_s is None:
            return block.duration_s + self._now.stopped_s
        return max(block.duration_s, block.time_s - self._now.last_end_s)

    def _step_bank(self, block: FeatureBlock) -> None:
        start_s = block.time_s - block.duration_s
        if (
            self._now.last_end_s is None
            or abs(start_s - self._now.last_end_s) > 0.5 * block.duration_s
        ):
            state, covariance = self._balance.start(block)
            self._bank.reset(state, covariance, self._now.probability)
        step, measurement = self._balance.step(block, _mode_transition(round(block.duration_s, 6)))
        output = self._bank.step(step, measurement)
        self._now.probability = output.mode_probability
        self._now.nis = float(output.nis.min()) / len(measurement)
        self._now.recent.append((block.duration_s, output.mode_probability))
        while sum(duration for duration, _ in self._now.recent) > self._settings.window_s * (
            1 + 1e-9
        ):
            if len(self._now.recent) == 1:
                break
            self._now.recent.pop(0)

    def estimate(self) -> PreloadEstimate:
        """Estimate after the last interval."""
        status, reasons = self._validity.status()
        time_s = self._validity.time_s
        if status is not EstimateStatus.ESTIMATED:
            return PreloadEstimate(
                time_s=time_s,
                status=status,
                method=self._settings.method,
                reasons=reasons,
                data_used_s=self._validity.informative_s,
            )
        if self._per_percent is None:
            missing = self._machine.missing_for_percent()
            return PreloadEstimate(
                time_s=time_s,
                status=status,
                method=self._settings.method,
                reasons=(
                    f"no_percent: preload in % is not available, {missing} is unknown; "
                    "the drag torque is",
                    *reasons,
                    *self._caveats(),
                ),
                drag_torque_nm=self._drag_interval(),
                data_used_s=self._validity.informative_s,
                nis=self._drag.nis,
            )
        return self._full_estimate(time_s, reasons)

    def _full_estimate(self, time_s: float, reasons: tuple[str, ...]) -> PreloadEstimate:
        probability = self._smoothed()
        weights = mode_weights(probability, self._settings.activation_exponent)
        percent = float(weights @ self._levels)
        low, high = self._percent_interval(percent)
        rating = self._machine.axis.dynamic_load_rating_n
        assert rating is not None
        return PreloadEstimate(
            time_s=time_s,
            status=EstimateStatus.ESTIMATED,
            method=self._settings.method,
            preload_percent=percent,
            low=low,
            high=high,
            preload_n=percent / 100.0 * rating,
            drag_torque_nm=self._drag_interval(),
            mode_probability={
                f"{level:g}": float(value)
                for level, value in zip(self._levels, probability, strict=True)
            },
            data_used_s=self._validity.informative_s,
            nis=self._now.nis,
            reasons=(*reasons, *self._caveats()),
        )

    def _caveats(self) -> tuple[str, ...]:
        if not self._machine.effects:
            return ()
        names = ", ".join(effect.name for effect in self._machine.effects)
        return (f"effects_unused: this estimator does not use the machine file's {names}",)

    def _smoothed(self) -> Floats:
        durations = np.array([duration for duration, _ in self._now.recent])
        return np.asarray(durations @ np.array([p for _, p in self._now.recent]) / durations.sum())

    def _percent_interval(self, percent: float) -> tuple[float, float]:
        """95 % interval around both the bank's reading and the drag filter's.

        The bank reads between its levels by weighing them, which its own spread does not measure;
        the drag filter's error is known, with what is unknown of drag per percent and of the drag
        that is not the screw's.
        """
        assert self._per_percent is not None
        drag, preload = self._machine.model.preload_drag_nm, self._machine.model.preload_n
        assert drag is not None and preload is not None
        other = self._machine.other_drag_nm
        direct = self._direct_percent(self._per_percent)
        scale_sigma = direct * float(np.hypot(drag.tolerance, preload.tolerance))
        drag_sigma = float(np.hypot(self._drag.sigma_nm, other.sigma)) / self._per_percent
        reach = TWO_SIDED_95 * float(np.hypot(scale_sigma, drag_sigma))
        low, high = min(percent, direct) - reach, max(percent, direct) + reach
        return max(0.0, low), max(0.0, high)

    def _drag_interval(self) -> Interval:
        value, reach = self._drag.drag_nm, TWO_SIDED_95 * self._drag.sigma_nm
        return Interval(value=value, low=value - reach, high=value + reach)

    def snapshot(self) -> dict[str, Any]:
        """Whole state as JSON-able values."""
        return {
            "schema": _SNAPSHOT_SCHEMA,
            "drag": self._drag.snapshot(),
            "validity": self._validity.snapshot(),
            **_STORED.dump(self._now),
            "bank": None if self._per_percent is None else self._bank.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none of this estimator's."""
        if snapshot.get("schema") != _SNAPSHOT_SCHEMA:
            raise ValueError(f"no {_SNAPSHOT_SCHEMA} snapshot")
        now = _STORED.load(snapshot)
        self._drag.restore(snapshot["drag"])
        self._validity.restore(snapshot["validity"])
        if self._per_percent is not None:
            self._bank.restore(snapshot["bank"])
        self._now = now


def kalman_imm(machine: Machine, options: EstimatorOptions) -> ImmPreloadEstimator:
    """Estimator with Kalman filters (see registry)."""
    return _of_options("kf-imm", machine, options)


def sliding_innovation_imm(machine: Machine, options: EstimatorOptions) -> ImmPreloadEstimator:
    """Estimator with sliding innovation filters (see registry)."""
    return _of_options("sif-imm", machine, options)


def _of_options(
    method: Literal["kf-imm", "sif-imm"], machine: Machine, options: EstimatorOptions
) -> ImmPreloadEstimator:
    settings = ImmSettings(
        method=method,
        engine=options.engine,
        activation_exponent=options.activation_exponent,
        window_s=options.window_s,
    )
    return ImmPreloadEstimator(machine, settings)
