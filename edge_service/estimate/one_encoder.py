"""Preload of an axis with one encoder that is tested by shaking from time to time.

The antiresonance f_a of the table (fingerprint/response/notch.py) shows the compliance in series,

    C / C_0 = (f_a0 / f_a)^2 (M_0 / M) = (1 - s) + s c(p / p_0)

with the share s of the fresh nut and its compliance c under the standing force (5.3.11). A rest
that has loosened is softer, too. Then friction says more: both accounts are weighed by its level.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.features import FeatureBlock
from ..messages.samples import Floats
from ..messages.stored import Stored, StoredFloats
from ..models.commissioned import Notch
from ..models.machine import Machine
from ..models.screw.nut_law import nut_deflection
from .imm.modes import LEVEL_NAMES, LEVELS_PERCENT
from .interface import Engine, UnsuitableMachineError
from .mixture.estimator import MixturePreloadEstimator
from .mixture.hypotheses import DAY_S
from .mixture.posterior import FAULTS, LOST_SHARE, UNDETERMINED_HIGH_SHARE
from .mixture.torque_alone import CELLS, below, cells, prior, quantile, weigh

EXPONENTS = {1 / 3: 0.4, 0.28: 0.3, 0.22: 0.2, 1 / 6: 0.1}
"""Assumption: exponent of stiffness over preload, its probability; balls (5.3.11) to rollers."""
OTHER_REST = 0.1
"""Assumption: probability that the rest has changed, by any share of the compliance alike."""
WORN_PER_DAY, OTHER_NUT = 0.05, 0.02
"""Assumption: wear of ln(preload) by the root of the days; probability that it went otherwise."""
OTHER_FRICTION = 0.2
"""Assumption: probability that the level of friction says nothing: other grease, other guides."""
COLD_WARMTH = 0.05
"""Assumption: most friction that warmth takes between tests after the same warm-up, a share."""
LEAST_WIDTH_PERCENT, DUE_WIDTH_PERCENT, WIDER = 0.5, 3.5, 1.5  # WIDER than the test's: due, too
DUE_DAYS, LONGEST_DAYS, SLACK_PERCENT = 7.0, 45.0, 0.35  # beyond by more: due, and then stays
FAR_SHARE, FEED_FACTOR, SIGMAS = 0.05, 4.0 / 3.0, 3.0
"""Most distance from the place of commissioning, over the stroke, and between the feeds."""
LOAD_ERROR, MOST_LOAD_ERROR = 0.02, 0.1
"""Assumption: error of M R^2 / J from test to test, which shows another payload; the most."""


@dataclass(slots=True)
class _Test:
    """Preload that the last test has left: probability of each cell, (n,), and its age, s."""

    weights: StoredFloats
    age_s: float = 0.0
    last_s: float | None = None
    changed: bool = False  # friction, since then


_STORED: Stored[_Test | None] = Stored(_Test | None)


class OneEncoderEstimator(MixturePreloadEstimator):
    """Preload from the last test, and from the level of friction since then."""

    def __init__(self, machine: Machine) -> None:
        from .commissioning.shares import WANTED_TESTS  # 25 ms that others do without

        super().__init__(machine)
        assert machine.commissioned is not None and machine.commissioned.notch is not None
        self._notch, model = machine.commissioned.notch, self._model
        repeats = self._notch.repeats
        self._freedom = repeats - 1 if repeats >= WANTED_TESTS else math.inf
        fresh = (model.fresh_percent, model.fresh_preload_n, model.clearance_share)
        percents = cells() * model.fresh_percent
        soft = [nut_deflection(model.hanging_n, each, *fresh)[1] for each in percents]
        self._softening = np.array(soft) / np.interp(1.0, cells(), soft)
        healthy = self._told(self._by_stiffness(0.0, 0.0))
        self._expected_percent = healthy["high"] - healthy["low"]

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._test: _Test | None = None

    def resume(self, stopped_s: float) -> None:
        """Continue after an unobserved stop, on a clock of its own."""
        super().resume(stopped_s)
        if self._test is not None:
            self._test = _Test(self._test.weights, self._test.age_s + max(stopped_s, 0.0))

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""
        super().update(block)
        if self._test is not None:
            begin_s = self._test.last_s
            passed_s = block.duration_s if begin_s is None else block.time_s - begin_s
            self._test.age_s += max(passed_s, 0.0)
            self._test.last_s = block.time_s

    def take_test(self, seen: Notch, time_s: float) -> PreloadEstimate:
        """Take a test that ended then, and tell the preload. Raises ValueError: it says nothing."""
        rest = OTHER_REST * prior()
        weights = (1.0 - OTHER_REST) * self._by_stiffness(*self._softer(seen)) + rest
        known = self._notch.friction_nm
        if seen.friction_nm is not None and known is not None:
            level = self._by_friction(seen.friction_nm, 0.01 * known, known, COLD_WARMTH)
            level = (1.0 - OTHER_FRICTION) * level + OTHER_FRICTION
            weights, rest = weights * level, rest * level
        whole = np.sum(weights)
        self._test = _Test(weights / whole, last_s=time_s)
        other = "rest_changed: no preload has this stiffness and friction: check coupling, bearings"
        return PreloadEstimate(
            time_s=time_s,
            status=EstimateStatus.ESTIMATED,
            method="mixture",
            reasons=(other,) if np.sum(rest) > 0.5 * whole else (),
            **self._told(self._test.weights),
        )

    def estimate(self) -> PreloadEstimate:
        """Estimate after the last interval."""
        now = super().estimate()
        if now.status is not EstimateStatus.ESTIMATED or now.drag_torque_nm is None:
            return now
        test, days = self._test, math.inf if self._test is None else self._test.age_s / DAY_S
        since = ""
        if test is not None and days <= LONGEST_DAYS:
            drag, limits = now.drag_torque_nm, self._limits
            sigma = (drag.high - drag.low) / (2.0 * 1.96)
            level = self._by_friction(drag.value, sigma, limits.coulomb_nm, self._settings.warmth)
            worn = _worn(test.weights, days)
            told, by_test = (self._told(x) for x in (_combined(worn, level, OTHER_NUT), worn))
            told["fault_probability"] = now.fault_probability | told["fault_probability"]
            now = now.model_copy(update=told)
            low, high = by_test["low"], by_test["high"]
            slack = 0.0 if test.changed else SLACK_PERCENT
            most = max(WIDER * (high - low), DUE_WIDTH_PERCENT) + slack
            inside = low - slack <= told["preload_percent"] <= high + slack
            test.changed = not inside or told["high"] - told["low"] > most
            since = "; friction has changed since" if test.changed else ""
        if days <= DUE_DAYS and not since:
            return now
        assert now.low is not None and now.high is not None
        ago = "no test yet" if test is None else f"the last test was {days:.0f} days ago"
        due = (
            f"test_due: {ago}{since}, and the interval is {now.high - now.low:.1f} points wide: "
            "run `edge-service motion chirp` after the usual warm-up; on a healthy axis it is "
            f"{self._expected_percent:.1f} then"
        )
        return now.model_copy(update={"reasons": (*now.reasons, due)})

    def _softer(self, seen: Notch) -> tuple[float, float]:
        """Logarithm of the compliance over the fresh one, and its error beyond that of repeats."""
        known, axis = self._notch, self._machine.axis
        far_m = abs(seen.place_rad - known.place_rad) * self._model.ratio_m_per_rad
        if axis.stroke_m is not None and far_m > FAR_SHARE * axis.stroke_m:
            raise ValueError(f"another place than at commissioning, {1e3 * far_m:.0f} mm away")
        if not 1.0 / FEED_FACTOR < seen.feed_rad_s / known.feed_rad_s < FEED_FACTOR:
            raise ValueError(f"a feed of {seen.feed_rad_s:.3g} rad/s, not {known.feed_rad_s:.3g}")
        softer = 2.0 * math.log(known.antiresonance_hz / seen.antiresonance_hz)
        old, new = (x.antiresonance_sigma_hz / x.antiresonance_hz for x in (known, seen))
        variance = 4.0 * max(new**2 - old**2, 0.0)
        heavier = math.log(seen.inertia_ratio / known.inertia_ratio)
        if abs(heavier) > SIGMAS * LOAD_ERROR:
            error = seen.inertia_ratio_sigma / seen.inertia_ratio
            if error > MOST_LOAD_ERROR:
                raise ValueError(f"another payload, known to {error:.0%} only: take it off")
            softer, variance = softer - heavier, variance + LOAD_ERROR**2
        return softer, math.sqrt(variance)

    def _by_stiffness(self, softer: float, worse: float) -> Floats:
        """Density of the compliance with each cell, (n,): Student's t of the few repeats."""
        from scipy import stats  # 60 MB that an axis without a test by shaking does without

        known = self._notch
        z = stats.norm.ppf((np.arange(9) + 0.5) / 9.0)
        share = np.clip(known.nut_share + known.nut_share_sigma * z, 0.02, 0.98)[:, None]
        sigma = math.hypot(known.compliance_scatter, worse)
        likelihood = np.zeros(CELLS)
        for exponent, probability in EXPONENTS.items():
            expected = np.log(1.0 - share + share * self._softening ** (3.0 * exponent))
            density = stats.t.pdf((softer - expected) / sigma, self._freedom) / sigma
            likelihood += probability * np.mean(density, axis=0)
        return np.asarray(prior() * likelihood)

    def _by_friction(self, level_nm: float, sigma_nm: float, all_nm: float, warm: float) -> Floats:
        """Likelihood of each cell, (n,), by the level of dry friction."""
        fresh_nm = self._model.drag_per_percent_nm * self._model.fresh_percent
        friction = (warm, self._settings.together, self._settings.apart)
        other_nm, share = max(all_nm - fresh_nm, 0.0), self._limits.error_share
        likelihood = weigh(level_nm, sigma_nm, fresh_nm, other_nm, share, friction) / prior()
        return np.asarray(likelihood / np.mean(likelihood))

    def _told(self, weights: Floats) -> dict[str, Any]:
        """Numbers of an estimate with these weights of the cells, (n,)."""
        weights = weights / np.sum(weights)
        fresh, newtons = self._model.fresh_percent, self._model.fresh_preload_n
        middle, low, high = (quantile(each, weights) for each in (0.5, 0.025, 0.975))
        middle, high = min(middle, 1.0), max(min(high, 1.0), UNDETERMINED_HIGH_SHARE)
        low = min(low, high - LEAST_WIDTH_PERCENT / fresh) if low > LOST_SHARE else 0.0
        edges = 0.5 * (np.array(LEVELS_PERCENT[1:]) + LEVELS_PERCENT[:-1]) / fresh
        under = [1.0, *(below(edge, weights) for edge in edges.tolist()), 0.0]
        return {
            "preload_percent": fresh * middle,
            "low": fresh * low,
            "high": fresh * high,
            "preload_n": newtons * middle,
            "mode_probability": dict(zip(LEVEL_NAMES, (-np.diff(under)).tolist(), strict=True)),
            "fault_probability": {FAULTS[0]: below(1.0 - LOST_SHARE, weights)},
        }

    def snapshot(self) -> dict[str, Any]:
        """The whole state as JSON-able values."""
        return {**super().snapshot(), "test": _STORED.dump(self._test)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go on from a snapshot; ValueError if it is none of this axis', and nothing is changed."""
        test = _STORED.load(snapshot.get("test"))
        if test is not None and len(test.weights) != CELLS:
            raise ValueError(f"a damaged snapshot: {len(test.weights)} values of the test")
        super().restore(snapshot)
        self._test = test


def _combined(weights: Floats, likelihood: Floats, doubt: float) -> Floats:
    """Probabilities of the cells, (n,): those given, or, if they are doubted, by friction alone.

    Friction weighs the two accounts; it makes none narrower.
    """
    alone = prior() * likelihood
    believed = (1.0 - doubt) * np.sum(weights * likelihood)
    doubted = doubt * np.sum(alone) / np.sum(prior())
    return (believed * weights + doubted * alone / np.sum(alone)) / (believed + doubted)


def _worn(weights: Floats, days: float) -> Floats:
    """Probabilities of the cells, (n,), after some days in which the preload may have worn."""
    share = np.log(cells())
    lost = (share[None, :] - share[:, None]) / (WORN_PER_DAY * math.sqrt(max(days, 1e-3)))
    kernel = np.exp(-0.5 * lost**2) * (lost >= 0.0) / cells()[:, None]
    return np.asarray(kernel / np.sum(kernel, axis=0) @ weights)


def mixture(machine: Machine, _engine: Engine) -> MixturePreloadEstimator:
    """Estimator for a commissioned axis (see interface). Raises UnsuitableMachineError."""
    learned = machine.commissioned
    if learned is None or machine.drag_per_percent_nm is None:
        raise UnsuitableMachineError(
            "needs a machine file written by `edge-service commission` with model.preload_n, "
            "model.preload_drag_nm and axis.dynamic_load_rating_n"
        )
    tested = learned.notch is not None and learned.transmission is None
    return OneEncoderEstimator(machine) if tested else MixturePreloadEstimator(machine)
