"""The benches: what this software reaches, measured on axes whose truth is known."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

Progress = Callable[[str], None]


class BenchReport(Protocol):
    """Findings of a bench."""

    def as_text(self) -> str:
        """A table for people."""

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values."""


@dataclass(frozen=True, slots=True)
class Bench:
    """One bench: a module of this room with `run(seeds, progress) -> BenchReport`.

    Attributes:
        name: of the sub-command.
        purpose: one line for its help.
        seeds: simulated axes of the full form.
    """

    name: str
    module: str
    purpose: str
    seeds: int

    def run(self, seeds: int, progress: Progress) -> BenchReport:
        """Measure with so many seeds, 1 or more."""
        module = importlib.import_module(f".{self.module}", __package__)
        report: BenchReport = module.run(seeds, progress)
        return report


BENCHES = (
    Bench(
        "identification",
        "identification_bench",
        "Identified parameters against the truth.",
        100,
    ),
)
