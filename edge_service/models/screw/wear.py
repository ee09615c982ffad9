"""Loss of preload over the life of a ball screw: the thesis' simulations 1 to 4 (4.6)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...messages.samples import Floats

RUN_IN_SHARE = 0.1
"""Share of the life that counts as running in, where the loss may be steeper (Zhao, 4.3)."""


@dataclass(frozen=True, slots=True)
class Wear:
    """Preload as a function of wear time.

    Attributes:
        start_percent: preload at wear time 0, in percent of the dynamic load rating.
        end_percent: preload from `life_s` on.
        shape: `linear`, or `sudden`: the whole loss at half of the life.
        run_in_loss: share of the loss within the first tenth of the life, then linear; 0.1 is a
            straight line, more is "steeper at first, then linear" (thesis, 4.3).
    """

    start_percent: float
    end_percent: float
    shape: Literal["linear", "sudden"] = "linear"
    run_in_loss: float = RUN_IN_SHARE

    def __post_init__(self) -> None:
        if self.start_percent < 0.0 or self.end_percent < 0.0:
            raise ValueError(
                "preload in percent must not be negative, got "
                f"{self.start_percent:g} to {self.end_percent:g}"
            )
        if not 0.0 <= self.run_in_loss <= 1.0:
            raise ValueError(f"run_in_loss must lie in 0 to 1, got {self.run_in_loss:g}")

    def preload_percent(self, wear_time_s: Floats, life_s: float) -> Floats:
        """Preload at wear times (n,), s, of a life of `life_s`; percent of the load rating."""
        age = np.clip(wear_time_s / life_s, 0.0, 1.0)
        lost = np.where(age < 0.5, 0.0, 1.0) if self.shape == "sudden" else self._lost_share(age)
        return self.start_percent + lost * (self.end_percent - self.start_percent)

    def _lost_share(self, age: Floats) -> Floats:
        """Share of the loss at an age of 0 to 1, (n,)."""
        early = age * (self.run_in_loss / RUN_IN_SHARE)
        late = 1.0 - (1.0 - age) * ((1.0 - self.run_in_loss) / (1.0 - RUN_IN_SHARE))
        return np.where(age < RUN_IN_SHARE, early, late)


SCENARIOS: dict[str, Wear] = {
    "healthy": Wear(10.0, 10.0),
    "gradual": Wear(10.0, 0.0),
    "partial": Wear(7.5, 2.5),
    "sudden": Wear(10.0, 0.0, shape="sudden"),
}
"""The thesis' simulations 3, 1, 2 and 4, by name."""
