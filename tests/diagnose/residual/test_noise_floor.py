"""The floor of a gap is its noise: no structure raises it, whatever its name, and no burst."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edge_service.diagnose.residual.noise import noise_floor, ordinary_rms
from edge_service.diagnose.session.session import TORQUE_GAP, Session
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
