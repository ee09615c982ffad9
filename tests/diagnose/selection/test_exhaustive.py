"""All sets of up to three effects are weighed, whatever greed would have begun with."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest

from edge_service.diagnose.candidates.design_matrix import DesignMatrix
from edge_service.diagnose.candidates.normal_equations import NormalEquations
from edge_service.diagnose.residual.noise import Noise
from edge_service.diagnose.selection.problem import MOST_EFFECTS, SelectionProblem
from edge_service.diagnose.session.session import Session

ROWS, EFFECTS = 400, 9
NOISE = Noise({"torque_nm": 0.1}, {"torque_nm": 0.1}, {"torque_nm": 200.0}, {"torque_nm": 0.02})


@dataclass(frozen=True)
class Wave:
    """A regressor whose columns are given to the design matrix directly."""

    name: str
    size: int = 1
    form: str = "amount"

    def columns(self, _session: Session, _channel: str) -> np.ndarray:
        raise AssertionError("the sums are known")


def posed(seed: int) -> SelectionProblem:
    """Correlated columns of which three make the gap; the first one is a nuisance."""
    random = np.random.default_rng(seed)
    common = random.normal(size=(ROWS, 3))
    regressors = (Wave("level"), *(Wave(f"effect{k}", 1 + k % 2) for k in range(EFFECTS)))
    sizes = [regressor.size for regressor in regressors]
    columns = common @ random.normal(size=(3, sum(sizes))) + random.normal(size=(ROWS, sum(sizes)))
    first = np.concatenate(([0], np.cumsum(sizes)))
    gap = columns[:, [first[2], first[5], first[8]]] @ [0.5, -0.4, 0.3]
    gap += 0.1 * random.normal(size=ROWS)
    precision = np.full(sum(sizes), 1e-6)
    precision[0] = 100.0
    design = DesignMatrix(
        regressors=regressors,
        nuisances=1,
        mean=np.zeros(sum(sizes)),
        precision=precision,
        first=first,
        columns={"torque_nm": columns.astype(np.float32)},
        equations={"torque_nm": NormalEquations.of(columns.astype(np.float32), gap)},
        alternatives=(1,) * len(regressors),
    )
    session = machine = None  # what is scored is the design and its noise
    return SelectionProblem(session, machine, design, NOISE, {})


@pytest.mark.parametrize("seed", range(5))
def test_no_set_of_three_is_better_than_the_first(seed: int) -> None:
    problem = posed(seed)
    chosen = range(1, EFFECTS + 1)
    every = [
        problem.fit(each)
        for count in range(1, MOST_EFFECTS + 1)
        for each in itertools.combinations(chosen, count)
    ]
    best = max(every, key=lambda each: each.score)
    found = problem.leading_sets([problem.fit((1,))])
    assert max(each.score for each in found) == pytest.approx(best.score)
    assert best.names in [each.names for each in found]


def test_a_fit_is_the_weighted_least_squares_of_its_columns() -> None:
    problem = posed(2)
    chosen = problem.fit((2, 5, 8))
    index = problem.design.indices(chosen.regressors)
    columns = problem.design.columns["torque_nm"][:, index].astype(float)
    gap_on_columns = problem.design.equations["torque_nm"].cross[index]
    variance = chosen.rms["torque_nm"] ** 2 + NOISE.discrepancy["torque_nm"] ** 2
    weight = NOISE.effective["torque_nm"] / ROWS / variance
    normal = weight * columns.T @ columns + np.diag(problem.design.precision[index])
    expected = np.linalg.solve(normal, weight * gap_on_columns)
    assert chosen.coefficients == pytest.approx(expected, rel=1e-4)
