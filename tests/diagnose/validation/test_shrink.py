"""The shrink that is expected on other motion, and whether it comes true there."""

import numpy as np
import pytest

from edge_service.diagnose.session.session import Rows, Session
from edge_service.diagnose.validation.assessment import on_other_motion
from edge_service.models.effects.registry import active_effect
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, session_of
from ..test_diagnosis import diagnosed

COUNT = 4000


def rows(gap: np.ndarray) -> Rows:
    """A gap over a motion that visits every regime in every block."""
    random = np.random.default_rng(3)
    variables = {
        "motor_speed_rad_s": random.uniform(-100.0, 100.0, COUNT),
        "motor_acceleration_rad_s2": random.uniform(-500.0, 500.0, COUNT),
        "table_position_m": random.uniform(0.0, 0.8, COUNT),
    }
    return Rows(gap, variables, np.arange(COUNT) // 200)


def test_a_gap_that_shrinks_alike_everywhere_is_sure() -> None:
    gap = np.random.default_rng(1).standard_normal(COUNT)
    found = on_other_motion(rows(gap), [0.3 * gap])
    assert (found.low, found.estimate, found.high) == pytest.approx((0.7, 0.7, 0.7))


def test_a_gap_that_shrinks_at_speed_only_may_shrink_less_elsewhere() -> None:
    gap = np.ones(COUNT)
    fast = np.abs(rows(gap).variables["motor_speed_rad_s"]) > 50.0
    found = on_other_motion(rows(gap), [np.where(fast, 0.0, gap)])
    share = float(fast.mean())
    assert found.estimate == pytest.approx(1.0 - np.sqrt(1.0 - share))
    # Of 16 regimes of weight 1/2 each, 8 are fast: their share is Beta(4, 4).
    fast_share = np.random.default_rng(5).beta(4.0, 4.0, 100_000)
    low, high = np.quantile(1.0 - np.sqrt(1.0 - fast_share), (0.05, 0.95))
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.03)


def test_what_may_come_out_otherwise_widens_the_interval() -> None:
    gap = np.ones(COUNT)
    found = on_other_motion(rows(gap), [0.2 * gap, 0.5 * gap, 0.9 * gap])
    assert found.estimate == pytest.approx(0.8)
    assert found.low == pytest.approx(0.1)
    assert found.high == pytest.approx(0.8)


@pytest.mark.slow
@pytest.mark.parametrize("cause", ["drag_error", "torque_ripple", "timestamp_skew"])
def test_it_comes_true_on_another_recording(machine: Machine, cause: str) -> None:
    found, _ = diagnosed(machine, (cause,), seed=3)
    (named,) = found.effects
    other = session_of(machine, frame_of(recorded((cause,), 93, axis_seed=3)))
    effects = [active_effect(named.name, values) for values in named.entries]
    left = Session.of_runs(other.runs, other.baseline, effects).channels[named.channel].rms
    realised = 1.0 - left / other.channels[named.channel].rms
    assert named.shrink.estimate == pytest.approx(realised, abs=0.06)
