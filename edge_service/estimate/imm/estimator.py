"""Preload estimator of the thesis (section 4.5) on intervals of a closed-loop axis.

Five mode-matched filters at 10, 7.5, 5, 2.5 and 0 % of preload (KF or SIF), interacting by the
thesis' mode transition matrix; the preload is the weighted, smoothed sum of the levels (4.5.2 to
4.5.4). Two things differ from the thesis, because a machine runs in closed loop: the direction of
friction is that of the speed, and intervals in which the axis rests or turns round are left out
(the bank's mode probabilities rest with it: a screw does not wear while it stands still).
"""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from ...messages.estimate import EstimateStatus, PreloadEstimate
from ...messages.features import FeatureBlock
from ...messages.interval import Interval
from ...messages.samples import Floats
from ...messages.stored import Number, Stored, StoredFloats
from ...models.machine import Machine
from ..interface import Engine
from ..validity import Validity
from .bank import KALMAN, BankStart, CompiledBank, FilterpyBank, LinearStep
from .drag import DragFilter
from .modes import LEVEL_NAMES, LEVELS_PERCENT, scaled_mode_transition, weighted_level

TWO_SIDED_95 = 1.959963984540054
BEYOND_LEVELS_PERCENT = 0.6
"""Scale on which drag beyond the highest or lowest level counts as a misfit, points."""
REVERSAL_GATE_S, MIN_SPEED_RAD_S = 0.1, 0.3
"""Time after a reversal or a start that is left out (presliding, wind-up); slower motion, too."""
TORQUE_ERROR_NM = 1e-6
"""Least error of the modelled torque, mean over 0.1 s; it is that between two neighbouring levels,
which lets the weighted sum read between them: much less makes it jump from level to level."""
ANGLE_NOISE_RAD, SPEED_NOISE_RAD_S = 1e-5, 1e-2
"""Noise of the angle, and of a speed from neighbouring angles."""
WINDOW_S = 1.0
"""Causal moving average of the mode probabilities over informative motion."""
SLIDING_BOUNDARY: Floats = np.array([0.05, 0.07])
"""Delta of the sliding innovation filter for [rad, rad/s]."""
_SNAPSHOT_SCHEMA = "imm-preload/2"
Method = Literal["kf-imm", "sif-imm"]


@dataclass(slots=True)
class _State:
    """Everything on which the next interval depends, but for drag filter, bank and validity."""

    probability: StoredFloats  # of the modes after the last interval, (r,)
    recent: list[tuple[float, StoredFloats]] = field(default_factory=list)
    """Durations, s, and mode probabilities within the window."""
    last_end_s: float | None = None  # end of the last informative interval
    stopped_s: float = 0.0  # length of a stop before the next interval
    nis: Number = float("nan")  # normalised innovation squared of the last step


_STORED: Stored[_State] = Stored(_State)


class ImmPreloadEstimator:
    """Preload and drag of one axis from its feature blocks (see interface.PreloadEstimator).

    Args:
        machine: the baseline model. Without load rating, preload or fresh drag there is no preload
            in percent, only drag.
        engine: of Kalman filters; `filterpy` is slow.
        method: Kalman or sliding innovation filters.
    """

    def __init__(
        self, machine: Machine, engine: Engine = "compiled", method: Method = "kf-imm"
    ) -> None:
        self._machine, self._method, self._other = machine, method, machine.other_drag_nm
        self._levels = np.array(LEVELS_PERCENT)
        self._per_percent = machine.drag_per_percent_nm
        self._drag = DragFilter(machine)
        if self._per_percent is not None:
            self._balance = MomentumBalance(machine, self._levels * self._per_percent)
            self._bank = CompiledBank(SLIDING_BOUNDARY if method == "sif-imm" else KALMAN)
            if engine == "filterpy" and method == "kf-imm":
                self._bank = FilterpyBank()
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._drag.reset()
        if self._per_percent is not None:
            self._bank.restore({})
        self.validity = Validity()
        self._now = _State(np.full(len(self._levels), 1.0 / len(self._levels)))

    def interrupt(self) -> None:
        """Withdraw the number until motion comes: no data for longer than a number may stand."""
        self.validity.interrupt()

    def resume(self, stopped_s: float) -> None:
        """Continue after an unobserved stop, on a clock of its own: the drag has wandered."""
        self.validity.interrupt()
        self._now.recent.clear()
        self._now.last_end_s, self._now.stopped_s = None, max(stopped_s, 0.0)

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""
        used = informative(block)
        if used:
            last_s, elapsed_s = self._now.last_end_s, block.duration_s + self._now.stopped_s
            if last_s is not None:
                elapsed_s = max(block.duration_s, block.time_s - last_s)
            self._drag.update(block, elapsed_s)
            if self._per_percent is not None:
                self._step_bank(block)
            self._now.last_end_s, self._now.stopped_s = block.time_s, 0.0
        self.validity.update(block, used, self._surprise() if used else None)

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
        return (self._drag.drag_nm - self._other.value) / per_percent

    def _step_bank(self, block: FeatureBlock) -> None:
        start_s, last_s = block.time_s - block.duration_s, self._now.last_end_s
        if last_s is None or abs(start_s - last_s) > 0.5 * block.duration_s:
            self._bank.reset(self._balance.start(block, self._now.probability))
        step, measurement = self._balance.step(block)
        output = self._bank.step(step, measurement)
        self._now.probability = output.mode_probability
        self._now.nis = float(output.nis.min()) / len(measurement)
        recent = self._now.recent
        recent.append((block.duration_s, output.mode_probability))
        while len(recent) > 1 and sum(duration for duration, _ in recent) > WINDOW_S * (1 + 1e-9):
            recent.pop(0)

    def estimate(self) -> PreloadEstimate:
        """Estimate after the last interval."""
        status, reasons = self.validity.status()
        common = self.validity.told(self._method, status)
        if status is not EstimateStatus.ESTIMATED:
            return PreloadEstimate(**common, reasons=reasons)
        if self._machine.effects:
            names = ", ".join(effect.name for effect in self._machine.effects)
            reasons += (f"effects_unused: this estimator does not use the machine file's {names}",)
        drag_nm, reach_nm = self._drag.drag_nm, TWO_SIDED_95 * self._drag.sigma_nm
        low, high = drag_nm - reach_nm, drag_nm + reach_nm
        common["drag_torque_nm"] = Interval(value=drag_nm, low=low, high=high)
        if self._per_percent is None:
            missing = self._machine.missing_for_percent()
            reason = f"no_percent: preload in % is not available, {missing} is unknown; "
            reasons = (f"{reason}the drag torque is", *reasons)
            return PreloadEstimate(**common, reasons=reasons, nis=self._drag.nis)
        durations = np.array([duration for duration, _ in self._now.recent])
        smoothed = durations @ np.array([p for _, p in self._now.recent]) / durations.sum()
        percent = float(weighted_level(smoothed, self._levels))
        low, high = self._percent_interval(percent, self._per_percent)
        rating = self._machine.axis.dynamic_load_rating_n
        assert rating is not None
        return PreloadEstimate(
            **common,
            preload_percent=percent,
            low=low,
            high=high,
            preload_n=percent / 100.0 * rating,
            mode_probability=dict(zip(LEVEL_NAMES, smoothed.tolist(), strict=True)),
            nis=self._now.nis,
            reasons=reasons,
        )

    def _percent_interval(self, percent: float, per_percent: float) -> tuple[float, float]:
        """95 % interval around both the bank's reading and the drag filter's.

        The bank reads between its levels by weighing them, which its own spread does not measure;
        the drag filter's error is known, with what is unknown of drag per percent and of the drag
        that is not the screw's.
        """
        drag, preload = self._machine.model.preload_drag_nm, self._machine.model.preload_n
        assert drag is not None and preload is not None
        direct = self._direct_percent(per_percent)
        scale_sigma = direct * float(np.hypot(drag.tolerance, preload.tolerance))
        drag_sigma = float(np.hypot(self._drag.sigma_nm, self._other.sigma)) / per_percent
        reach = TWO_SIDED_95 * float(np.hypot(scale_sigma, drag_sigma))
        low, high = min(percent, direct) - reach, max(percent, direct) + reach
        return max(0.0, low), max(0.0, high)

    def snapshot(self) -> dict[str, Any]:
        """Whole state as JSON-able values."""
        return {
            "schema": _SNAPSHOT_SCHEMA,
            "drag": self._drag.snapshot(),
            "validity": self.validity.snapshot(),
            **_STORED.dump(self._now),
            "bank": None if self._per_percent is None else self._bank.snapshot(),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none of this estimator's."""
        if snapshot.get("schema") != _SNAPSHOT_SCHEMA:
            raise ValueError(f"no {_SNAPSHOT_SCHEMA} snapshot")
        now = _STORED.load(snapshot)
        self._drag.restore(snapshot["drag"])
        self.validity.restore(snapshot["validity"])
        if self._per_percent is not None:
            self._bank.restore(snapshot["bank"])
        self._now = now


def informative(block: FeatureBlock) -> bool:
    """Good data of steady motion in one direction."""
    if not block.usable or abs(block.direction_mean) < 0.999:
        return False
    if block.since_reversal_s < REVERSAL_GATE_S:
        return False
    travel_rad = abs(block.angle_end_rad - block.angle_start_rad)
    return travel_rad >= MIN_SPEED_RAD_S * block.duration_s


class MomentumBalance:
    """Momentum balance as steps of [angle, speed] for modes that differ in their drag torque.

    With J w' = u - D w - (d_j + other) sgn(w) integrated over the interval (thesis, eq. 4.3.4)::

        w_1 = w_0 + (T / J) (mean(u) - D mean(w) - d mean(s))
        a_1 = a_0 + T w_0 + (T^2 / J) (lever(u) - D lever(w) - d lever(s))

    mean(w) and lever(w) come from the measured angle, so that nothing is approximated inside.
    `mode_drag_nm` is the screw's own of each mode, (r,).
    """

    def __init__(self, machine: Machine, mode_drag_nm: Floats) -> None:
        self._inertia = machine.model.inertia_kg_m2.value
        self._viscous = machine.model.viscous_nm_s_per_rad.value
        self._drag = mode_drag_nm + machine.other_drag_nm.value
        error_nm = max(float(np.abs(np.diff(mode_drag_nm)).min()), TORQUE_ERROR_NM)
        self._error_density = 0.1 * error_nm**2
        self._measurement_noise = np.diag([ANGLE_NOISE_RAD**2, SPEED_NOISE_RAD_S**2])

    def start(self, block: FeatureBlock, mode_probability: Floats) -> BankStart:
        """Start as measured at the beginning of an interval."""
        state = np.array([block.angle_start_rad, block.speed_start_rad_s])
        return BankStart(state, self._measurement_noise.copy(), mode_probability)

    def step(self, block: FeatureBlock) -> tuple[LinearStep, Floats]:
        """The bank's step over the interval, and the measurement (2,) at its end."""
        duration, inertia = block.duration_s, self._inertia
        speed_mean = (block.angle_end_rad - block.angle_start_rad) / duration
        speed_lever = (block.angle_mean_rad - block.angle_start_rad) / duration
        viscous_mean, viscous_lever = self._viscous * speed_mean, self._viscous * speed_lever
        net_mean = block.torque_mean_nm - viscous_mean - self._drag * block.direction_mean
        net_lever = block.torque_lever_nm - viscous_lever - self._drag * block.direction_lever
        noise = self._error_density / inertia**2
        step = LinearStep(
            transition=np.array([[1.0, duration], [0.0, 1.0]]),
            drive=np.column_stack([duration**2 * net_lever, duration * net_mean]) / inertia,
            process_noise=noise
            * np.array([[duration**3 / 3.0, duration**2 / 2.0], [duration**2 / 2.0, duration]]),
            observation=np.eye(2),
            measurement_noise=self._measurement_noise,
            mode_transition=scaled_mode_transition(round(duration, 6)),
        )
        return step, np.array([block.angle_end_rad, block.speed_end_rad_s])


kalman_imm = partial(ImmPreloadEstimator, method="kf-imm")
sliding_innovation_imm = partial(ImmPreloadEstimator, method="sif-imm")
"""Estimators with Kalman and with sliding innovation filters (see interface)."""
