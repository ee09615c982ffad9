"""Selection: all sets of up to three are weighed; a gap matters as stated; why none is judged."""

import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.diagnose.candidates.design_matrix import DesignMatrix
from edge_service.diagnose.candidates.normal_equations import NormalEquations
from edge_service.diagnose.candidates.regressors import unobservable
from edge_service.diagnose.residual.noise import INTERPOLATION_M, Noise
from edge_service.diagnose.selection.problem import MOST_EFFECTS, SelectionProblem
from edge_service.diagnose.session.session import Session
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from edge_service.models.machine import Machine

from ..conftest import diagnosed, recorded, session_of

ROWS, EFFECTS = 400, 9
NOISE = Noise({"torque_nm": 0.1}, {"torque_nm": 0.1}, {"torque_nm": 200.0}, {"torque_nm": 0.02})


def drag(machine_file: Path, folder: Path, more: str = "") -> dict[str, Any]:
    stated = folder / "machine.toml"
    stated.write_text(machine_file.read_text() + more)
    return diagnosed(stated, folder, str(recorded(("drag_error",), 3).write_csv(folder / "a.csv")))


@pytest.mark.slow
@pytest.mark.smoke
def test_a_gap_within_the_stated_tolerance_is_none(machine_file: Path, tmp_path: Path) -> None:
    found = drag(machine_file, tmp_path, "\n[tolerance]\ntorque_nm = 0.5\nposition_m = 1e-3\n")
    assert (found["verdict"], found["effects"]) == ("no_gap", [])
    gap = found["gap"]
    assert gap["torque_nm"]["tolerance"] == 0.5
    assert gap["torque_nm"]["before"] < 0.5
    assert gap["torque_nm"]["floor_source"] == "recording"


@pytest.mark.slow
def test_without_one_it_is_a_part_of_the_floor(machine_file: Path, tmp_path: Path) -> None:
    found = drag(machine_file, tmp_path)
    assert [each["name"] for each in found["effects"]] == ["drag_error"]
    torque, position = found["gap"]["torque_nm"], found["gap"]["transmission_m"]
    assert torque["tolerance"] == pytest.approx(torque["noise_floor"])
    assert position["tolerance"] == INTERPOLATION_M


@pytest.mark.parametrize("value", ["0.0", "-1.0", '"much"'])
def test_a_tolerance_that_is_none_is_refused_in_a_line(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], value: str
) -> None:
    wrong = tmp_path / "machine.toml"
    wrong.write_text(machine_file.read_text() + f"\n[tolerance]\ntorque_nm = {value}\n")
    assert main(["gap", "--machine", str(wrong), "none.csv"]) == 2
    said = capsys.readouterr().err
    assert "tolerance.torque_nm" in said
    assert said.count("\n") == 1


@pytest.mark.slow
def test_an_inertia_hardly_known_does_not_hide_friction(machine_file: Path, tmp_path: Path) -> None:
    text = machine_file.read_text()
    value = load_machine(machine_file).model.inertia_kg_m2.value
    loose = re.sub(
        "inertia_kg_m2 = .*", f"inertia_kg_m2 = {{ value = {value}, tolerance = 0.3 }}", text
    )
    path = tmp_path / "loose.toml"
    path.write_text(loose)
    found = drag(path, tmp_path)
    assert [each["name"] for each in found["effects"]] == ["drag_error"]
    assert found["effects"][0]["probability"] > 0.9


@pytest.mark.parametrize(
    ("missing", "blamed", "needs_it", "shows_elsewhere"),
    [
        (TORQUE, "no torque recorded", "inertia_error", "backlash"),
        (TABLE_POSITION, "one encoder only", "backlash", "external_force"),
    ],
)
def test_a_motion_that_shows_nothing_is_not_the_fault_of_a_channel(
    machine: Machine, missing: str, blamed: str, needs_it: str, shows_elsewhere: str
) -> None:
    """One way at one speed shows neither play nor a force that comes and goes."""
    time_s = np.arange(6000) * 1e-3
    noise = np.random.default_rng(1).standard_normal((3, len(time_s)))
    way_m = 0.2 + 0.05 * time_s
    channels = {
        ANGLE: way_m / machine.transmission_ratio_m_per_rad + 5e-6 * noise[0],
        TORQUE: 0.4 + 0.01 * noise[1],
        TABLE_POSITION: way_m + 5e-8 * noise[2],
    }
    del channels[missing]
    reasons = unobservable(session_of(machine, SampleFrame(time_s, channels)))
    assert reasons[needs_it].startswith(blamed)
    assert reasons[shows_elsewhere] == "not visible in this motion"


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
