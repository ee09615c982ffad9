"""Preload from two witnesses, drag and stretch, over what may have happened to the axis."""

import math
from typing import Any

import numpy as np

from ..messages.estimate import EstimateStatus, Interval, PreloadEstimate
from ..messages.features import FeatureBlock, Phase
from ..models.machine import Machine
from .fused_answers import answers, limits_of
from .fused_begin import begun, doubt
from .fused_kernel import take
from .fused_model import FusedSettings, drift_of, fused_model, start_of
from .fused_snapshot import mixture_snapshot, restored_mixture
from .fused_state import (
    DRY,
    GAIN,
    GUIDE,
    MASS,
    PRELOAD,
    VISCOUS,
    WEARING,
    Reading,
)
from .known_effects import KnownEffects
from .validity import Validity, ValiditySettings

_SNAPSHOT_SCHEMA = "fused-preload/3"
SPAWN_S = 2.0
NEW_S = 2.0
"""A hypothesis younger than this, s of motion, is new."""
UNREST_S, UNREST_HIGH, UNREST_LOW = 8.0, 0.7, 0.35
"""Over how much motion, and from which share of it led by new hypotheses the model is doubted."""
VIBRATING_SHARE = 0.25
LONGEST_STOP_S = 3600.0
"""An axis that has stood for an hour is as cold and as stiff as after a night."""
CHANGED_SHARE = 0.01
"""Probability that what a stop hid has made another axis of it: a new screw, a new reference."""
WORST = 1000.0
"""What an interval counts with while model and data disagree, as normalised innovation squared."""
WILDEST = (1e4, 1e6, 1e4, 1.0)
"""Torque N m, acceleration rad/s^2, speed rad/s, stretch m that no axis has."""


class FusedPreloadEstimator:
    """Preload and drag of one commissioned axis (see interface.PreloadEstimator)."""

    def __init__(
        self,
        machine: Machine,
        settings: FusedSettings | None = None,
        validity: ValiditySettings | None = None,
        hold_s: float = 10.0,
    ) -> None:
        if machine.commissioned is None:
            raise ValueError("the fused estimator needs a commissioned machine file")
        self._settings = settings or FusedSettings()
        self._validity_settings = validity or ValiditySettings(surprise_worst=WORST)
        self._hold_s = hold_s
        self._machine = machine
        self._model = fused_model(machine, self._settings)
        self._drift = drift_of(machine, self._model, self._settings)
        self._start = start_of(machine, self._model, self._settings)
        self._limits = limits_of(machine, self._model, self._start)
        self._known = KnownEffects.of_machine(machine)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._validity = Validity(self._validity_settings, self._hold_s)
        self._mixture = begun(self._start, self._model)
        self._last_s: float | None = None
        self._stopped_s = 0.0
        self._since_spawn_s = 0.0
        self._unrest, self._restless = 0.0, False
        self._nis = float("nan")

    def interrupt(self) -> None:
        """Nothing was heard for longer than a number may stand: none stands until motion comes."""
        self._validity.interrupt()

    def resume(self, stopped_s: float) -> None:
        """Go on after a stop that nobody saw, on a clock of its own.

        What drifts has drifted for as long; the preload as if the axis had worked all the while.
        """
        self._validity.interrupt()
        self._last_s, self._stopped_s = None, min(max(stopped_s, 0.0), LONGEST_STOP_S)
        rows = slice(0, int(self._mixture.alive[0]))
        worn = self._drift.walk[PRELOAD] ** 2 * self._stopped_s
        self._mixture.covariance[rows, PRELOAD, PRELOAD] += worn
        doubt(self._mixture, CHANGED_SHARE, self._start, self._model)
        self._since_spawn_s = SPAWN_S

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""
        quiet = block.usable and not vibrates(block)
        surprises = [self._take(block, phase) for phase in block.phases] if quiet else []
        calm = [surprise for surprise in surprises if not math.isnan(surprise)]
        self._validity.update(block, bool(calm), max(calm, default=None))

    def _follows(self, block: FeatureBlock) -> bool:
        """Whether an interval begins where the last that was taken has ended."""
        if self._last_s is None:
            return False
        return abs(block.time_s - block.duration_s - self._last_s) < 0.1 * block.duration_s

    def _take(self, block: FeatureBlock, phase: Phase) -> float:
        if self._known is not None:
            phase = self._known.freed(phase, block.steady_direction, block.time_s)
        reading = self._reading(block, phase)
        if not plausible(reading):
            return math.nan
        elapsed_s = block.duration_s if self._last_s is None else block.time_s - self._last_s
        elapsed_s = min(max(elapsed_s + self._stopped_s, 0.0), 1e5)
        self._last_s, self._stopped_s = block.time_s, 0.0
        self._since_spawn_s += phase.steady_s
        spawn = self._since_spawn_s >= SPAWN_S
        if spawn:
            self._since_spawn_s = 0.0
        nis = take(self._mixture, self._model, self._drift, reading, elapsed_s, spawn)
        if not math.isnan(nis):
            self._nis = nis
            self._follow_unrest(phase.steady_s)
        return nis

    def _follow_unrest(self, steady_s: float) -> None:
        """Follow how often something new has to be believed of the axis."""
        leader = int(np.argmax(self._mixture.log_weight))
        new = self._mixture.age_s[leader] < NEW_S and self._mixture.mode[leader] != WEARING
        self._unrest += min(steady_s / UNREST_S, 1.0) * (float(new) - self._unrest)
        if self._unrest > UNREST_HIGH:
            self._restless = True
        elif self._unrest < UNREST_LOW:
            self._restless = False

    def _reading(self, block: FeatureBlock, phase: Phase) -> Reading:
        ratio = self._model.ratio_m_per_rad
        stretch, torque = math.nan, phase.torque_nm
        if self._model.compliance_m_per_n > 0.0:
            stretch = ratio * phase.angle_rad - phase.table_m
        if not math.isnan(block.external_force_n):
            torque += ratio * block.external_force_n
            stretch += self._model.compliance_m_per_n * block.external_force_n
        return Reading(
            phase.steady_s,
            block.steady_direction,
            torque,
            phase.acceleration_rad_s2,
            phase.speed_rad_s,
            phase.table_m,
            stretch,
            self._follows(block),
        )

    def estimate(self) -> PreloadEstimate:
        """What is known after the last interval."""
        status, reasons = self._validity.status()
        if status is EstimateStatus.ESTIMATED and (doubt := self._implausible()):
            status, reasons = EstimateStatus.INVALID, (doubt,)
        if status is not EstimateStatus.ESTIMATED:
            return PreloadEstimate(
                time_s=self._validity.time_s,
                status=status,
                reasons=reasons,
                data_used_s=self._validity.informative_s,
            )
        taught, rating = self._machine.commissioned, self._machine.axis.dynamic_load_rating_n
        assert taught is not None and rating is not None
        two_encoders = taught.transmission is not None
        said = answers(self._mixture, self._model, self._limits, two_encoders)
        percent, low, high = said.preload
        return PreloadEstimate(
            time_s=self._validity.time_s,
            status=status,
            reasons=self._caveats(),
            preload_percent=percent,
            low=low,
            high=high,
            preload_n=percent / 100.0 * rating,
            drag_torque_nm=_interval(said.drag),
            stiffness_n_per_m=None if said.stiffness is None else _interval(said.stiffness),
            mode_probability=said.levels,
            fault_probability=said.faults,
            data_used_s=self._validity.informative_s,
            nis=self._nis,
        )

    def _implausible(self) -> str | None:
        """Why no axis can be as the leading hypothesis says; None if one can."""
        if self._restless:
            return (
                "model_mismatch: something new has to be believed of the axis every other second: "
                "it has an effect that the model lacks, which `edge-service diagnose` looks for"
            )
        state = self._mixture.mean[int(np.argmax(self._mixture.log_weight))]
        model, start = self._model, self._start.mean
        rest_nm = state[DRY] + model.ratio_m_per_rad * state[GUIDE]
        coulomb_nm = start[DRY] + model.ratio_m_per_rad * start[GUIDE]
        coulomb_nm += model.drag_per_percent_nm * model.fresh_percent
        for name, value, low, high in (
            ("preload", state[PRELOAD], -1.0, 1.5 * model.fresh_percent + 1.0),
            ("friction beside the screw's", rest_nm, -0.1 * coulomb_nm, 3.0 * coulomb_nm),
            ("viscous friction", state[VISCOUS], 0.2 * start[VISCOUS], 4.0 * start[VISCOUS]),
            ("payload", state[MASS], -0.8 * model.table_mass_kg, 5.0 * model.table_mass_kg),
            ("change of the torque constant", state[GAIN], -0.2, 0.2),
        ):
            if not low - 1e-9 <= value <= high + 1e-9:
                return (
                    f"model_mismatch: {name} would be {value:.3g}, expected {low:.3g} to "
                    f"{high:.3g}: check torque constant, lead, signs and units"
                )
        return None

    def _caveats(self) -> tuple[str, ...]:
        if self._known is None or not self._known.left:
            return ()
        names = ", ".join(self._known.left)
        return (f"effects_left: {names} of the machine file: the estimate follows these by itself",)

    def snapshot(self) -> dict[str, Any]:
        """The whole state as JSON-able values."""
        return {
            "schema": _SNAPSHOT_SCHEMA,
            "validity": self._validity.snapshot(),
            "mixture": mixture_snapshot(self._mixture),
            "last_s": self._last_s,
            "stopped_s": self._stopped_s,
            "since_spawn_s": self._since_spawn_s,
            "unrest": [self._unrest, self._restless],
            "nis": None if math.isnan(self._nis) else self._nis,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot; ValueError if it is none of this axis', and nothing is changed."""
        if snapshot.get("schema") != _SNAPSHOT_SCHEMA:
            raise ValueError(f"no {_SNAPSHOT_SCHEMA} snapshot")
        mixture = restored_mixture(snapshot["mixture"], self._mixture)
        self._validity.restore(snapshot["validity"])
        self._mixture = mixture
        self._last_s = snapshot["last_s"]
        self._stopped_s = float(snapshot["stopped_s"])
        self._since_spawn_s = float(snapshot["since_spawn_s"])
        self._unrest, self._restless = snapshot["unrest"]
        self._nis = float("nan") if snapshot["nis"] is None else float(snapshot["nis"])


def _interval(told: tuple[float, float, float]) -> Interval:
    value, low, high = told
    return Interval(value=value, low=low, high=high)


def vibrates(block: FeatureBlock) -> bool:
    """Whether a process shakes the axis: it speeds up and slows down for much of one interval."""
    steady_s = sum(phase.steady_s for phase in block.phases)
    shaken_s = min(block.accelerating.steady_s, block.braking.steady_s)
    return shaken_s > VIBRATING_SHARE * steady_s and shaken_s > 0.0


def plausible(reading: Reading) -> bool:
    """Whether an axis can be as a phase says; the stretch may be missing."""
    stretch_m = 0.0 if math.isnan(reading.stretch_m) else reading.stretch_m
    told = (reading.torque_nm, reading.acceleration_rad_s2, reading.speed_rad_s, stretch_m)
    return all(abs(value) <= most for value, most in zip(told, WILDEST, strict=True))
