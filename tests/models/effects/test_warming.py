"""The housing's sensor follows the effects that warm the axis, late."""

import math

import numpy as np
import pytest
from scipy import signal

from edge_service.messages.samples import SETPOINT, TABLE_POSITION, TEMPERATURE, Floats
from edge_service.models.effects.contribution import HOUSING_LAG_S, lagged_warming
from edge_service.models.effects.library.warmup import WARM_RISE_K
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import AMBIENT_C, FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import Dwell, Move, Setpoints

HOME_M = 0.04


def temperature_c(machine: Machine, seconds: int, *effects: str) -> Floats:
    settings = FeedDriveSettings.of_machine(machine, 1000.0, [parse_effect(e) for e in effects])
    drive = FeedDrive(settings, HOME_M, 6.8, 1)
    setpoints = np.tile([HOME_M, 0.0, 0.0], (1000 * seconds, 1))
    parts = [drive.advance(part, np.full(len(part), 6.8)) for part in np.array_split(setpoints, 3)]
    return np.concatenate([part.channels[TEMPERATURE] for part in parts])


@pytest.mark.parametrize("time_constant_s", [30.0, HOUSING_LAG_S, 900.0])
def test_the_housing_is_a_first_order_lag_behind_the_screw(time_constant_s: float) -> None:
    time_s = np.linspace(0.0, 3000.0, 30_001)
    screw_k = 10.0 * (1.0 - np.exp(-time_s / time_constant_s))
    _, housing_k, _ = signal.lsim(([1.0], [HOUSING_LAG_S, 1.0]), screw_k, time_s)
    found = lagged_warming(10.0, time_constant_s).rise_k(time_s)
    assert found == pytest.approx(housing_k, abs=0.01)


def test_growth_and_warm_up_warm_one_housing(machine: Machine) -> None:
    growth, friction = "thermal_growth:rise_k=20,time_constant_s=60", "warmup:time_constant_s=60"
    cold = temperature_c(machine, 60)
    assert np.mean(cold) == pytest.approx(AMBIENT_C, abs=0.01)
    late = math.exp(-1.0) * 60.0 - math.exp(-60.0 / HOUSING_LAG_S) * HOUSING_LAG_S
    share = 1.0 - late / (60.0 - HOUSING_LAG_S)
    for effects, rise_k in (
        ((growth,), 20.0),
        ((friction,), WARM_RISE_K),
        ((growth, friction), 20.0),
        (("warmup:excess_nm=0",), 0.0),
    ):
        found = temperature_c(machine, 60, *effects)
        assert np.mean(found[-200:]) == pytest.approx(AMBIENT_C + share * rise_k, abs=0.02)
        assert np.mean(found[:200]) == pytest.approx(AMBIENT_C, abs=0.02)


@pytest.mark.parametrize(("guide_n", "hunts"), [(0.0, True), (2.0, False)])
def test_play_without_any_guide_friction_hunts_at_rest(
    machine: Machine, guide_n: float, hunts: bool
) -> None:
    """Nothing holds the table within its play; two newtons of guide friction do."""
    model = machine.model.model_copy(update={"guide_force_n": Quantity(value=guide_n)})
    axis = machine.model_copy(update={"model": model})
    effect = parse_effect("backlash:width_m=1e-5")
    settings = FeedDriveSettings.of_machine(axis, 1000.0, [effect])
    moves = (Move(0.1, 0.1, 2.0, 200.0), Dwell(3.0), Move(-0.1, 0.1, 2.0, 200.0), Dwell(3.0))
    count = int(1000 * sum(segment.duration_s for segment in moves))
    setpoints = Setpoints(iter(moves), HOME_M, 1000.0).take(count)
    frame = FeedDrive(settings, HOME_M, 6.8, 1).advance(setpoints, np.full(count, 6.8))
    error_m = frame.channels[SETPOINT] - frame.channels[TABLE_POSITION]
    assert (np.ptp(error_m[-1500:]) > 3e-6) == hunts
