"""Use, friction and live values from intervals whose content is known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.health.live_features import LiveFeatures
from edge_service.health.wear.friction import FrictionWatch
from edge_service.health.wear.usage import FORCE_EDGES_N, ScrewGeometry, UsageCounter
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock

RATIO = 0.02 / (2.0 * math.pi)
NS = 1_000_000_000


def block(speed_rad_s: float = 50.0, place_m: float = 0.4, **more: object) -> FeatureBlock:
    """A tenth of a second at steady speed."""
    angle = place_m / RATIO
    values: dict[str, object] = dict.fromkeys(FEATURE_FIELDS, 0.0)
    values |= {
        "time_s": 1.0,
        "duration_s": 0.1,
        "sample_count": 100,
        "fault": Fault.NONE,
        "torque_mean_nm": math.copysign(0.2, speed_rad_s) + 0.002 * speed_rad_s,
        "angle_start_rad": angle - 0.05 * speed_rad_s,
        "angle_end_rad": angle + 0.05 * speed_rad_s,
        "angle_mean_rad": angle,
        "speed_start_rad_s": speed_rad_s,
        "speed_end_rad_s": speed_rad_s,
        "moving_fraction": 1.0 if speed_rad_s else 0.0,
        "reversal_count": 0,
        "since_reversal_s": 1.0,
        "table_mean_m": place_m + 3e-6,
        "temperature_c": 21.0,
        "external_force_n": math.nan,
    }
    return FeatureBlock(**(values | more))


def test_way_hours_reversals_and_the_map_add_up():
    meter = UsageCounter(ScrewGeometry(RATIO, 0.8), 5)
    for place_m in np.linspace(0.0, 0.79, 80).tolist():
        meter.add(block(40.0, place_m))
    meter.add(block(0.0, 0.5))
    meter.add(block(40.0, 0.5, fault=Fault.GAP))
    meter.add(block(-40.0, 0.5, reversal_count=1))
    use = meter.use()
    way_m = 0.1 * 40.0 * RATIO
    assert (use.distance_m, use.moving_s, use.observed_s) == pytest.approx((81 * way_m, 8.1, 8.2))
    assert use.reversals == 1
    assert sum(use.way_m) == pytest.approx(81 * way_m, abs=0.001 * 40)
    assert max(use.way_m) == pytest.approx(3 * way_m, abs=0.001)
    force_n = (0.2 + 0.08) / RATIO
    part = next(k for k, edge in enumerate(FORCE_EDGES_N) if edge > force_n) - 1
    assert use.force_way_m[part] == pytest.approx(use.distance_m, abs=0.001)


def test_use_goes_on_from_its_snapshot_and_ends_with_the_part():
    meter, other = (UsageCounter(ScrewGeometry(RATIO, 0.8), 5) for _ in range(2))
    meter.add(block())
    other.restore(meter.use())
    assert other.use() == meter.use()
    other.restart(9)
    assert (other.use().distance_m, other.use().since_time_ns) == (0.0, 9)


def test_friction_now_is_held_against_friction_at_first():
    watch = FrictionWatch()
    for speed in (-50.0, 50.0):
        for _ in range(200):
            watch.add(block(speed))
        for _ in range(3000):
            watch.add(block(speed, torque_mean_nm=math.copysign(0.1, speed) + 0.002 * speed))
    curve = watch.curve()
    assert curve.speed_rad_s == (-50.0, 50.0)
    assert curve.first_torque_nm == pytest.approx((-0.3, 0.3))
    assert curve.torque_nm == pytest.approx((-0.2, 0.2), abs=1e-3)
    other = FrictionWatch()
    other.restore(watch.snapshot())
    assert other.curve() == curve
    watch.restart_newest()
    assert watch.curve().count == ()
    watch.add(block(50.0, torque_mean_nm=0.15))
    assert watch.curve().torque_nm == (0.15,)
    assert watch.curve().first_torque_nm == pytest.approx((0.3,))


@pytest.mark.parametrize(
    "change",
    [
        {"speed_end_rad_s": 60.0},
        {"reversal_count": 1},
        {"since_reversal_s": 0.1},
        {"fault": Fault.STUCK},
        {"torque_mean_nm": math.nan},
    ],
)
def test_only_steady_speed_tells_friction(change):
    watch = FrictionWatch()
    watch.add(block(50.0, **change))
    assert watch.curve().count == ()


def test_live_points_and_channels():
    live = LiveFeatures(RATIO)
    assert live.channels() == ()
    for tenth in range(10):
        live.add(tenth * NS // 10, block())
    live.add(NS, replace(block(), fault=Fault.NO_TABLE, table_mean_m=math.nan))
    point = live.newest
    assert point.transmission_m is None
    assert point.position_m == pytest.approx(0.4)
    assert point.faults == ("no_table",)
    before = next(iter(live.since(NS // 2 - 1)))
    assert before.transmission_m == pytest.approx(3e-6)
    states = {each.channel: (each.state, each.good_share) for each in live.channels()}
    assert states["torque"] == ("ok", 1.0)
    assert states["table position"] == ("missing", pytest.approx(10 / 11))
    assert states["external force"] == ("missing", 0.0)
