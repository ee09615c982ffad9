"""Schedule of the poll groups."""

import math
from dataclasses import dataclass

from .config import ModbusConfig
from .requests import ReadRequest, plan_group


@dataclass(slots=True)
class PollGroup:
    """A group on a fixed grid of time, so that nothing drifts.

    Attributes:
        period_s: between two polls, s.
        requests: what one poll asks for.
        due_s: when the next poll is due, on the event loop's clock.
    """

    period_s: float
    requests: tuple[ReadRequest, ...]
    due_s: float

    @classmethod
    def all_of(cls, config: ModbusConfig, now_s: float) -> "list[PollGroup]":
        """Every group that has registers, the fastest first."""
        groups = [
            cls(period_s, requests, now_s)
            for name, period_s in config.poll_groups.items()
            if (requests := plan_group(config, name))
        ]
        return sorted(groups, key=lambda group: group.period_s)

    def step(self, now_s: float) -> int:
        """On to the next poll; returns how many were missed and are let go."""
        missed = max(math.floor((now_s - self.due_s) / self.period_s), 0)
        self.due_s += (1 + missed) * self.period_s
        return missed
