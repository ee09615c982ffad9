"""Aim of each row of the estimator's bench."""

from dataclasses import dataclass

from .plants.foreign import ROW as _FOREIGN
from .scores import Score

_WORDS = {
    "mae": "MAE <= {:g}",
    "false_drop": "false drop <= {:g}",
    "detection_s": "seen <= {:g} s",
    "interval_score": "score <= {:g}",
    "coverage": "coverage >= {:g}",
    "misleading": "misleading <= {:g}",
}


@dataclass(frozen=True, slots=True)
class Aim:
    """Limits of a row; None where there is none."""

    mae: float | None = None
    false_drop: float | None = None
    detection_s: float | None = None
    interval_score: float | None = None
    coverage: float | None = None
    misleading: float | None = None  # of the share of misleading numbers

    def text(self) -> str:
        limits = ((words, getattr(self, name)) for name, words in _WORDS.items())
        return ", ".join(words.format(limit) for words, limit in limits if limit is not None)

    def met(self, ours: Score) -> bool:
        """Return whether every limit is kept; what could not be measured is not."""
        names = ("mae", "false_drop", "detection_s", "interval_score")
        limits = {name: getattr(self, name) for name in names}
        kept = [x is None or getattr(ours, name) <= x for name, x in limits.items()]
        kept.append(self.misleading is None or ours.misleading <= self.misleading)
        kept.append(self.coverage is None or ours.coverage >= self.coverage)
        return all(kept)


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
    for name in ("constant", "ramp to 0", "ramp 75 to 25 %"):
        aims[f"closed loop: {name}"] = Aim(mae=0.05)
    aims["closed loop: full drop"] = Aim(mae=0.05, detection_s=0.3)
    aims["closed loop: one-point step"] = Aim(mae=0.05, detection_s=1.5)
    aims["warm-up 30 %, own plant"] = Aim(false_drop=0.1)
    aims["warm-up 30 %, one encoder"] = Aim(coverage=0.95, misleading=0.0)
    aims[f"{_FOREIGN}all scenarios"] = Aim(mae=0.25, interval_score=2.0)
    plain = ("healthy", "ramp to 0", "ramp 75 to 25 %", "full drop", "one-point step")
    aims |= {_FOREIGN + name: Aim() for name in (*plain, "constant 2 %", "constant 0 %")}
    aims[_FOREIGN + "full drop"] = Aim(detection_s=2.0)
    aims[_FOREIGN + "warm-up"] = Aim(false_drop=0.1)
    forces = (f"process force {share} % of the time" for share in (30, 40))
    for name in ("payload +10 kg", "relubrication", *forces):
        aims[_FOREIGN + name] = Aim(false_drop=0.3)
    aims[_FOREIGN + "warm-up, one encoder"] = Aim(coverage=0.95, misleading=0.0)
    return aims


AIMS = _aims()
