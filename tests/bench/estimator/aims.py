"""Aim of each row of the estimator's bench."""

import math
from dataclasses import dataclass

from .plants.foreign import ROW as _FOREIGN
from .plants.own import ERRORS
from .plants.spoiled import CASES
from .scores import Score

_WORDS = {
    "mae": "MAE <= {:g}",
    "worst": "worst <= {:g}",
    "false_drop": "false drop <= {:g}",
    "detection_s": "seen <= {:g} s",
    "interval_score": "score <= {:g}",
    "coverage": "coverage >= {:g}",
    "misleading": "misleading <= {:g}",
    "added": "added MAE <= {:g}",
    "grown": "MAE within {:.0%}",
}


@dataclass(frozen=True, slots=True)
class Aim:
    """Limits of a row; None where there is none."""

    mae: float | None = None
    worst: float | None = None
    false_drop: float | None = None
    detection_s: float | None = None
    interval_score: float | None = None
    coverage: float | None = None
    misleading: float | None = None  # of the share of misleading numbers
    added: float | None = None  # of the mean absolute error above that of the row `reference`
    grown: float | None = None  # of the same as a share
    reference: str | None = None

    def text(self) -> str:
        limits = ((words, getattr(self, name)) for name, words in _WORDS.items())
        return ", ".join(words.format(limit) for words, limit in limits if limit is not None)

    def met(self, ours: Score, reference: Score | None) -> bool:
        """Return whether every limit is kept; what could not be measured is not."""
        kept = [
            _within(getattr(ours, name), getattr(self, name))
            for name in ("mae", "worst", "false_drop", "detection_s", "interval_score")
        ]
        kept.append(self.misleading is None or ours.misleading <= self.misleading)
        kept.append(self.coverage is None or ours.coverage >= self.coverage)
        base = math.nan if reference is None else reference.mae
        kept.append(_within(abs(ours.mae - base) / base, self.grown))
        kept.append(_within(ours.mae - base, self.added))
        return all(kept)


def _within(value: float, limit: float | None) -> bool:
    return limit is None or value <= limit


def _aims() -> dict[str, Aim]:
    """Every row with its aim, in the order of the table."""
    late = (0.022, 0.022, 0.012, 0.025)
    aims: dict[str, Aim] = {}
    for simulation, limit in enumerate(late, start=1):
        seen_s = 0.2 if simulation == 4 else None
        name = f"thesis' simulation {simulation}"
        aims[f"{name}, open loop"] = Aim(mae=0.035, detection_s=seen_s)
        aims[f"{name}, after step 100"] = Aim(mae=limit)
    aims["thesis' one-point step, open loop"] = Aim(detection_s=0.5)
    aims["T = 0.1 s"] = Aim()
    aims |= {
        f"T = {interval} s": Aim(grown=0.1, reference="T = 0.1 s")
        for interval in ("0.02", "0.005", "0.001")
    }
    for name in ("constant", "ramp to 0", "ramp 75 to 25 %"):
        aims[f"closed loop: {name}"] = Aim(mae=0.05)
    aims["closed loop: full drop"] = Aim(mae=0.05, detection_s=0.3)
    aims["closed loop: one-point step"] = Aim(mae=0.05, detection_s=1.5)
    aims["warm-up 30 %, own plant"] = Aim(false_drop=0.1)
    aims["warm-up 30 %, one encoder"] = Aim(coverage=0.95, misleading=0.0)
    aims["40 min: warm-up, slow loss, step"] = Aim(mae=0.05, worst=0.15, detection_s=60.0)
    for name in ("payload +10 kg", "relubrication of the nut", "process force"):
        aims[f"{name}, own plant"] = Aim(false_drop=0.3)
    return aims | _foreign_aims() | _error_aims()


def _foreign_aims() -> dict[str, Aim]:
    aims = {f"{_FOREIGN}all scenarios": Aim(mae=0.25, interval_score=2.0)}
    plain = ("healthy", "ramp to 0", "ramp 75 to 25 %", "full drop", "one-point step")
    aims |= {_FOREIGN + name: Aim() for name in (*plain, "constant 2 %", "constant 0 %")}
    aims[_FOREIGN + "full drop"] = Aim(detection_s=2.0)
    aims[_FOREIGN + "warm-up"] = Aim(false_drop=0.1)
    forces = (f"process force {share} % of the time" for share in (30, 40))
    for name in ("payload +10 kg", "relubrication", *forces):
        aims[_FOREIGN + name] = Aim(false_drop=0.3)
    aims[_FOREIGN + "warm-up, one encoder"] = Aim(coverage=0.95, misleading=0.0)
    return aims


def _error_aims() -> dict[str, Aim]:
    exact, *wrong = (row for row, _ in ERRORS)
    limits = (0.1, 0.1, 0.1, 0.3)
    aims = {exact: Aim()}
    aims |= {
        row: Aim(added=limit, reference=exact) for row, limit in zip(wrong, limits, strict=True)
    }
    base = f"{_FOREIGN}no error"
    aims[base] = Aim()
    for name, limit in zip(("torque_gain", "inertia", "skew_s", "series"), limits, strict=True):
        aims[f"{_FOREIGN}{name} error"] = Aim(added=limit, reference=base)
    return aims | {case.name: Aim(misleading=0.0) for case in CASES}


AIMS = _aims()
