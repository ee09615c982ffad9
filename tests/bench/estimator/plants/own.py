"""Cases of the estimator's bench on the library's own plant."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from edge_service.estimate.imm.estimator import ImmPreloadEstimator
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.estimate.validity import Validity
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine

from ..axis import RATE_HZ, OwnAxis
from ..scores import Recorded, Score, Track, detection, follow, score

FULL_S, QUICK_S = 100.0, 40.0


@dataclass(frozen=True, slots=True)
class Part:
    """Contribution of one case to a row: the score of the mixture estimator, and of the thesis'."""

    row: str
    ours: Score
    thesis: Score | None = None


def judged(
    row: str,
    machine: Machine,
    nominal: Machine,
    case: Recorded,
    *,
    loss: tuple[float, float] | None = None,
    event_s: float = 0.0,
    every: int = 1,
) -> Part:
    """Both estimators over one case; `loss` is (when, the level that sees it)."""

    def scored(track: Track) -> Score:
        seen_s = math.nan if loss is None else detection(track, *loss)
        return score(track, event_s, seen_s)

    ours = follow(MixturePreloadEstimator(machine), case, every)
    thesis = ImmPreloadEstimator(nominal)
    thesis.validity = Validity(high=math.inf)  # the thesis' method doubts no number
    theirs = follow(thesis, case, every)
    return Part(row, scored(ours), scored(theirs))


def losses(fresh: float, duration_s: float) -> dict[str, tuple[Floats, tuple[float, float] | None]]:
    """Preload of each sample and when a loss is to be seen, by the row's name."""
    share = np.arange(round(duration_s * RATE_HZ)) / (duration_s * RATE_HZ)
    half_s = 0.5 * duration_s
    return {
        "closed loop: constant": (np.full_like(share, fresh), None),
        "closed loop: ramp to 0": (fresh * (1.0 - share), None),
        "closed loop: ramp 75 to 25 %": (fresh * (0.75 - 0.5 * share), None),
        "closed loop: full drop": (np.where(share < 0.5, fresh, 0.0), (half_s, 0.5 * fresh)),
        "closed loop: one-point step": (
            np.where(share < 0.5, fresh, fresh - 1.0),
            (half_s, fresh - 0.5),
        ),
    }


def closed_loop(seed: int, quick: bool) -> Iterator[Part]:
    """The four scenarios and a one-point step."""
    axis = OwnAxis(seed)
    for row, (percent, loss) in losses(axis.fresh_percent, QUICK_S if quick else FULL_S).items():
        case = axis.produced(percent, 5 + seed)
        yield judged(row, axis.commissioned(), axis.nominal(), case, loss=loss)


def warm_up(seed: int, quick: bool) -> Iterator[Part]:
    """All dry friction falls by 30 %, preload constant: with two encoders, and with one."""
    time_constant_s = 300.0 if quick else 600.0
    for one_encoder in (False, True):
        axis = OwnAxis(seed, one_encoder=one_encoder)
        percent = np.full(
            round((0.5 if quick else 2.0) * time_constant_s * RATE_HZ), axis.fresh_percent
        )
        case = warm_case(axis, percent, time_constant_s)
        row = "warm-up 30 %, one encoder" if one_encoder else "warm-up 30 %, own plant"
        yield judged(row, axis.commissioned(), axis.nominal(), case, event_s=10.0, every=2)


def warm_case(axis: OwnAxis, percent: Floats, time_constant_s: float, seed: int = 41) -> Recorded:
    """Production while 30 % of the commissioned dry friction fades."""
    machine = axis.commissioned()
    assert machine.commissioned is not None
    faded_nm = 0.3 * machine.commissioned.coulomb_nm
    effects = (
        f"drag_error:change_nm={-faded_nm}",
        f"warmup:excess_nm={faded_nm},time_constant_s={time_constant_s}",
    )
    return axis.produced(percent, seed, effects)
