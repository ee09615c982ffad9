"""Nothing is left to compile when the first sample comes."""

from pathlib import Path

import pytest

from edge_service.config import load_machine
from edge_service.estimate.interface import PreloadEstimator
from edge_service.messages.estimate import EstimateStatus
from edge_service.nodes.wiring import stages

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["machine", "commissioned", "emps", "cnc_mill"])
def test_the_estimators_have_answered(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An estimator that is still learning returns early, and its answers' kernels stay unused."""
    warmed: list[PreloadEstimator] = []
    make = stages.make_estimator

    def noted(*args: object) -> PreloadEstimator:
        warmed.append(make(*args))  # type: ignore[arg-type]
        return warmed[-1]

    monkeypatch.setattr(stages, "make_estimator", noted)
    stages.warm_up(machines=[load_machine(ROOT / "deploy" / f"{name}.toml")])
    (estimator,) = warmed
    assert estimator.estimate().status is EstimateStatus.ESTIMATED
