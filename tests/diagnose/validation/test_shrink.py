"""The shrink that is expected on other motion, and whether it comes true there."""

import numpy as np
import pytest

from edge_service.diagnose.pipeline import learnable
from edge_service.diagnose.result import ChannelGap, Diagnosis, NamedEffect, Series, Shrink, Verdict
from edge_service.diagnose.session.session import FOLDS, Rows, Session
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
    assert (found.low, found.estimate, found.high) == pytest.approx((0.1, 0.8, 0.8))


@pytest.mark.parametrize(("tails", "known"), [(1e-5, True), (0.01, False)])
def test_what_does_next_to_nothing_elsewhere_does_no_harm(tails: float, known: bool) -> None:
    left = np.where(np.arange(COUNT) < COUNT // 2, 0.5, 1.0 + tails)
    found = on_other_motion(rows(np.ones(COUNT)), [left])
    assert NamedEffect.model_construct(probability=0.9, tied=("a",), shrink=found).is_known is known


@pytest.mark.parametrize(
    ("tied", "off", "learned"),
    [
        ((), 1.0, {"load_offset", "viscous_error", "drag_error"}),
        (("load_friction",), 1.0, {"load_offset"}),  # less drag hides what the speed adds
        ((), 3.0, set()),  # values by other blocks that make the gap of these greater
    ],
)
def test_causes_are_learned_as_they_are_written(machine, tied, off, learned) -> None:
    """No cause comes into a file that without the others, or on other blocks, does harm."""
    whole = session_of(machine, frame_of(recorded((), 3)))
    amounts = {"load_offset": {"constant_nm": 0.05}, "drag_error": {"change_nm": -0.15}}
    amounts |= {"viscous_error": {"change_nm_s_per_rad": 2e-3}}
    made, absent, far = (
        [active_effect(n, {k: share * v for k, v in x.items()}) for n, x in amounts.items()]
        for share in (1.0, -1.0, off)
    )
    session = Session.of_runs(whole.runs, whole.baseline, [*whole.modelled, *absent])
    shrink = Shrink(estimate=0.5, low=0.4, high=0.6)
    known = {"probability": 0.95, "shrink": shrink, "entries": ({},), "channel": "torque_nm"}
    classes = {each: (each,) for each in amounts} | {"drag_error": ("drag_error", *tied)}
    effects = [NamedEffect.model_construct(name=n, tied=x, **known) for n, x in classes.items()]
    series = Series(fitted=[made, *([far] * FOLDS)])
    gap = dict.fromkeys(session.channels, ChannelGap(before=1, after=1, noise_floor=0, unit="m"))
    told = {"verdict": Verdict.AMBIGUOUS, "gap": gap, "effects": effects, "series": series}
    found = learnable(Diagnosis.model_construct(**told), session)
    assert {each.name for each in found} == learned


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
