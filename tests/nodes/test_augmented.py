"""A machine file that a diagnosis augmented goes wherever a machine file goes."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.diagnose.result import NamedEffect, Shrink
from edge_service.models.effects.registry import effect_names, get_effect
from edge_service.offline.diagnosis.diagnose import augmented_toml


def named(name: str) -> NamedEffect:
    """A typical fault, with numbers as a fit has them."""
    values = {key: np.float64(each) for key, each in get_effect(name).complete({}).items()}
    return NamedEffect(
        name=name,
        channel="torque_nm",
        probability=1.0,
        tied=(name,),
        shrink=Shrink(estimate=0.5, low=0.4, high=0.6),
        parameters={},
        entries=(values,),
    )


@pytest.fixture
def augmented(tmp_path: Path) -> Path:
    path = tmp_path / "augmented.toml"
    effects = [named(name) for name in ("stribeck", "inertia_error", "position_friction")]
    path.write_text(augmented_toml(DEFAULT_MACHINE.read_text(), effects))
    return path


@pytest.mark.parametrize("name", effect_names())
def test_every_effect_can_be_written_and_read_again(tmp_path: Path, name: str) -> None:
    text = augmented_toml(DEFAULT_MACHINE.read_text(), [named(name)])
    (written,) = tomllib.loads(text)["effects"]
    assert written == {"name": name, "parameters": get_effect(name).complete({})}
    path = tmp_path / "m.toml"
    path.write_text(text)
    assert [each.name for each in load_machine(path).effects] == [name]


def test_simulate_gap_estimate_and_motion_take_it(
    augmented: Path, trace_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = ["--machine", str(augmented)]
    simulated = tmp_path / "s.csv"
    assert main(["simulate", *machine, "--duration", "20", "--out", str(simulated)]) == 0
    capsys.readouterr()
    assert main(["gap", *machine, str(simulated), "--json"]) == 0
    own = json.loads(capsys.readouterr().out)["torque_nm"]
    assert main(["gap", str(simulated), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["torque_nm"] > 2.0 * own
    out = tmp_path / "estimates.csv"
    assert main(["estimate", *machine, str(trace_path), "--out", str(out)]) == 0
    assert len(out.read_text().splitlines()) == 200
    assert main(["motion", "friction", *machine, "--out", str(tmp_path / "m.csv")]) == 0
