"""The floor of a gap is its noise, and the interval that is found is the one it was put into."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edge_service.diagnose.localisation import where
from edge_service.diagnose.residual.noise import Noise, noise_floor, ordinary_rms
from edge_service.diagnose.session.session import TORQUE_GAP, Rows, Session
from edge_service.messages.samples import Floats
from edge_service.models.effects.baseline import Motion
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, session_of

NOISE_NM = 0.01


@pytest.fixture(scope="module")
def session(machine: Machine) -> Session:
    return session_of(machine, frame_of(recorded((), 3)))


def floor_of(session: Session, structure: Floats) -> float:
    """Floor of white noise with some structure (n,) on it."""
    rows = session.channels[TORQUE_GAP]
    noise = np.random.default_rng(4).normal(0.0, NOISE_NM, len(rows.gap))
    gap = noise + structure
    bare = replace(session, channels={TORQUE_GAP: replace(rows, gap=gap)})
    return noise_floor(bare, {TORQUE_GAP: gap})[0][TORQUE_GAP]


STRUCTURES: dict[str, Callable[[Motion], Floats]] = {
    "nothing": lambda motion: np.zeros(len(motion)),
    "drag": lambda motion: 0.1 * motion.direction,
    "viscous": lambda motion: 3e-3 * motion.speed_rad_s,
    "rough place": lambda motion: (
        0.1 * motion.direction * np.exp(-(((motion.position_m - 0.4) / 0.1) ** 2))
    ),
    "ripple": lambda motion: 0.1 * np.sin(12.0 * motion.angle_rad + 0.4),
    "bursts": lambda motion: np.where(motion.time_s % 10.0 < 1.5, 0.3, 0.0),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_structure_is_no_noise(session: Session, name: str) -> None:
    assert floor_of(session, session.column(TORQUE_GAP, STRUCTURES[name])) < 1.4 * NOISE_NM


def test_a_series_without_bursts_has_its_own_root_mean_square() -> None:
    series = np.random.default_rng(2).normal(0.0, 3.0, 20_000)
    assert ordinary_rms(series) == pytest.approx(3.0, rel=0.03)
    series[5000:6500] *= 30.0
    assert ordinary_rms(series) == pytest.approx(3.0, rel=0.08)


def test_the_chance_of_a_residual_falls_with_what_it_has_beyond_the_floor() -> None:
    one, no = {TORQUE_GAP: 1.0}, {TORQUE_GAP: 0.0}
    many, few = (Noise(one, no, {TORQUE_GAP: count}, one) for count in (400.0, 40.0))
    chances = [many.chance(TORQUE_GAP, rms) for rms in (0.5, 1.0, 1.1, 1.22, 1.4, 2.0, 5.0)]
    assert chances == sorted(chances, reverse=True)
    assert chances[1] > 0.4
    assert chances[-1] < 1e-9
    assert few.chance(TORQUE_GAP, 1.3) > many.chance(TORQUE_GAP, 1.3)
    tolerant = Noise(one, one, many.effective, one)
    assert tolerant.chance(TORQUE_GAP, 2.0**0.5) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("beyond", "share"), [(0.59, 0.1), (0.62, 0.05), (0.643, 0.02), (0.677, 0.01)]
)
def test_no_chance_is_less_than_that_of_simulated_healthy_axes(beyond: float, share: float) -> None:
    """Part of 320 healthy axes that left more than so much beyond the floor, over the floor."""
    one = {TORQUE_GAP: 1.0}
    noise = Noise(one, {TORQUE_GAP: 0.0}, {TORQUE_GAP: 400.0}, one)
    assert noise.chance(TORQUE_GAP, float(np.hypot(1.0, beyond))) >= share


ROWS = 12_000


def rows_of(gap_over: str, low: float, high: float) -> Rows:
    random = np.random.default_rng(4)
    time_s = np.arange(ROWS) * 0.01
    direction = np.where(random.random(ROWS) < 0.5, -1.0, 1.0)
    moving = time_s % 10.0 > 2.0  # between, it stands where the gap has another reason
    variables = {
        "motor_speed_rad_s": moving * direction * random.uniform(0.0, 100.0, ROWS),
        "table_position_m": np.where(moving, random.uniform(0.0, 0.8, ROWS), 0.7),
        "motor_angle_rad": random.uniform(0.0, 2.0 * np.pi, ROWS),
        "time_s": time_s,
        "direction": direction,
    }
    inside = (variables[gap_over] >= low) & (variables[gap_over] <= high)
    gap = np.where(moving, 0.1 * direction * inside, 0.3) + 0.005 * random.standard_normal(ROWS)
    return Rows(gap, variables, (time_s / 5.0).astype(np.int64))


@pytest.mark.parametrize(
    ("variable", "low", "high"),
    [("table_position_m", 0.2, 0.4), ("motor_speed_rad_s", 20.0, 60.0), ("time_s", 30.0, 60.0)],
)
def test_variable_and_interval(variable: str, low: float, high: float) -> None:
    first = where({TORQUE_GAP: rows_of(variable, low, high)})[0]
    assert first.variable == variable
    overlap = min(high, first.high) - max(low, first.low)
    assert overlap / (max(high, first.high) - min(low, first.low)) > 0.75
    assert first.energy > 0.9


def test_noise_lives_nowhere() -> None:
    rows = rows_of("table_position_m", 2.0, 3.0)
    assert where({TORQUE_GAP: rows}) == []


def test_a_channel_at_its_healthy_floor_holds_no_gap() -> None:
    rows = rows_of("table_position_m", 0.2, 0.4)
    assert where({TORQUE_GAP: rows}, {TORQUE_GAP: rows.rms}) == []


@pytest.mark.parametrize(("least", "low"), [(-np.inf, -1.0), (0.0, 0.0)])
def test_what_turns_with_the_direction_alone_or_is_there_one_way_lives_there(least, low):
    rows = rows_of("table_position_m", 0.0, 0.8)
    first = where({TORQUE_GAP: replace(rows, gap=np.maximum(rows.gap, least))})[0]
    assert (first.variable, first.low, first.high) == ("direction", low, 1.0)
