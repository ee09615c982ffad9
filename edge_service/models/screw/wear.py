"""Loss of preload over the life of a ball screw: the thesis' simulations 1 to 4 (4.6)."""

from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats


class Wear(NamedTuple):
    """Preload over wear time: straight from start to end, or all at once at half of the life."""

    start_percent: float  # of the dynamic load rating, at wear time 0
    end_percent: float  # from the end of the life on
    is_sudden: bool = False

    def preload_percent(self, wear_time_s: Floats, life_s: float) -> Floats:
        """Preload at wear times (n,), s, of a life of `life_s`; percent of the load rating."""
        age = np.clip(wear_time_s / life_s, 0.0, 1.0)
        lost = np.where(age < 0.5, 0.0, 1.0) if self.is_sudden else age
        return self.start_percent + lost * (self.end_percent - self.start_percent)


SCENARIOS: dict[str, Wear] = {
    "healthy": Wear(10.0, 10.0),
    "gradual": Wear(10.0, 0.0),
    "partial": Wear(7.5, 2.5),
    "sudden": Wear(10.0, 0.0, is_sudden=True),
}
"""The thesis' simulations 3, 1, 2 and 4, by name."""
