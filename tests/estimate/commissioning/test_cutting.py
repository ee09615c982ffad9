"""Production that cuts teaches no friction: `commission` refuses it, and says why."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ... import foreign_plant as plant
from ...adopt.test_real_machines import said

PLANT = plant.Machine()
DURATION_S = 90.0
FEED_M_S = 0.16  # the plant's rapids are faster, and cut nothing
AXIS_SEED = 7300
Cut = Callable[[plant.Case, float], tuple[plant.ProcessForce, ...]]
Bursts = tuple[tuple[float, float, float], ...]


def feeds(case: plant.Case) -> list[tuple[float, float]]:
    """Begin and length of every move that is no rapid, s."""
    speed = np.abs(np.gradient(case.setpoint_m, 1e-3))
    edges = np.flatnonzero(np.diff((speed > 1e-4).astype(int), prepend=0, append=0))
    moves = zip(edges[::2], edges[1::2], strict=True)
    return [(1e-3 * a, 1e-3 * (b - a)) for a, b in moves if speed[a:b].max() < FEED_M_S]


def burst_force(bursts: Bursts, ripple_share: float = 0.4) -> tuple[plant.ProcessForce, ...]:
    return (plant.ProcessForce(against_motion=1.0, ripple_share=ripple_share, bursts=bursts),)


def nothing(case: plant.Case, force_n: float) -> tuple[plant.ProcessForce, ...]:
    return ()


def steady(case: plant.Case, force_n: float) -> tuple[plant.ProcessForce, ...]:
    """Turning: the same smooth force in every feed."""
    return burst_force(tuple((at, long, force_n) for at, long in feeds(case)), ripple_share=0.0)


def intermittent(case: plant.Case, force_n: float) -> tuple[plant.ProcessForce, ...]:
    """Milling: now and then, against the motion or across it."""
    return (plant.ProcessForce(mean_n=force_n),)


def growing(case: plant.Case, force_n: float) -> tuple[plant.ProcessForce, ...]:
    """Tool that wears: from a third of the force to five thirds."""
    return burst_force(
        tuple((at, long, force_n * (1 / 3 + 4 / 3 * at / DURATION_S)) for at, long in feeds(case))
    )


def one_way(case: plant.Case, force_n: float) -> tuple[plant.ProcessForce, ...]:
    """Cross feed: in every feed along the axis, to the same side."""
    cuts = feeds(case)
    return tuple(
        plant.ProcessForce(against_motion=0.0, bursts=((at, long, force_n),)) for at, long in cuts
    )


def always(case: plant.Case, force_n: float) -> tuple[plant.ProcessForce, ...]:
    """Brake: against every motion."""
    return burst_force(((0.0, DURATION_S, force_n),), ripple_share=0.0)


def produced(cut: Cut, force_n: float, axis_seed: int, *, encoders: int = 2) -> plant.Recording:
    case = plant.axis_case(
        duration_s=DURATION_S, seed=axis_seed + 100, axis_seed=axis_seed, machine=PLANT
    )
    recording = plant.simulate(dataclasses.replace(case, events=cut(case, force_n)))
    if encoders == 1:
        for name in ("table_position_m", "table_speed_m_s"):
            recording.columns.pop(name, None)
    return recording


def commission(recording: plant.Recording, folder: Path, status: int) -> str:
    """Words of the command; a file stands there only where it succeeds."""
    nominal, out = folder / "nominal.toml", folder / "learned.toml"
    nominal.write_text(plant.nominal_machine_toml(PLANT))
    trace = recording.write_csv(folder / "production.csv")
    text = said("commission", "--machine", nominal, trace, "--out", out, status=status)
    assert out.exists() == (status == 0)
    assert status == 0 or str(trace) in text
    return text


@pytest.mark.slow
@pytest.mark.parametrize(("cut", "status"), [(nothing, 0), (steady, 2)])
def test_an_axis_that_cuts_is_refused_and_in_air_it_is_not(
    cut: Cut, status: int, tmp_path: Path
) -> None:
    text = commission(produced(cut, 100.0, AXIS_SEED), tmp_path, status)
    assert ("process forces" in text) == (status == 2)


@pytest.mark.slow
@pytest.mark.parametrize("cut", [steady, intermittent, growing, one_way])
@pytest.mark.parametrize(("force_n", "axis_seed"), [(80.0, 7300), (200.0, 7301), (500.0, 7302)])
def test_every_kind_of_cut_is_refused(
    cut: Cut, force_n: float, axis_seed: int, tmp_path: Path
) -> None:
    text = commission(produced(cut, force_n, axis_seed, encoders=1 + axis_seed % 2), tmp_path, 2)
    assert "process forces" in text or "another force is in it" in text


@pytest.mark.slow
def test_a_brake_heavier_than_the_table_is_refused(tmp_path: Path) -> None:
    """A force against every motion is friction, and the data sheet alone tells."""
    text = commission(produced(always, 250.0, AXIS_SEED), tmp_path, 2)
    assert "more than the table weighs" in text
