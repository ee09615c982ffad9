"""States that an earlier version has stored are read, and written again with the same bytes."""

import json
from pathlib import Path

import pytest

from edge_service.estimate.interface import make_estimator
from edge_service.messages.estimate import EstimateStatus

from ..bench.estimator.axis import OwnAxis

STATES = Path(__file__).parent / "states"


def stored(name: str) -> str:
    return (STATES / f"{name}.json").read_text("utf-8").strip()


@pytest.mark.parametrize("method", ["mixture", "kf-imm", "sif-imm"])
def test_a_stored_estimator_goes_on(method: str) -> None:
    machine = OwnAxis(1, one_encoder=True).commissioned()
    estimator = make_estimator(method, machine)
    estimator.restore(json.loads(stored(method)))
    assert json.dumps(estimator.snapshot(), allow_nan=False) == stored(method)
    assert estimator.estimate().status is EstimateStatus.ESTIMATED
