"""Beside recordings of the healthy machine only what changed since is a gap."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.diagnose.residual.reference import changes_by_place
from edge_service.diagnose.session.session import Session
from edge_service.messages.samples import ANGLE, TORQUE, SampleFrame
from edge_service.models.machine import Machine

from ..conftest import diagnosed, recorded, session_of


def trace(path: Path, causes: tuple[str, ...], seed: int) -> str:
    return str(recorded(causes, seed, axis_seed=3).write_csv(path))


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("healthy")
    return [trace(folder / f"healthy{seed}.csv", (), seed) for seed in (11, 12, 13)]


@pytest.fixture(scope="module")
def crude(machine_file: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A machine file that takes the axis for twice as viscous, without any drag."""
    text = machine_file.read_text()
    viscous = load_machine(machine_file).model.viscous_nm_s_per_rad.value
    text = re.sub("preload_drag_nm = .*", "preload_drag_nm = 1e-4", text)
    text = re.sub("viscous_nm_s_per_rad = .*", f"viscous_nm_s_per_rad = {2.0 * viscous}", text)
    path = tmp_path_factory.mktemp("crude") / "machine.toml"
    path.write_text(text)
    return str(path)


@pytest.mark.slow
def test_without_them_a_crude_model_is_a_gap(crude: str, tmp_path: Path) -> None:
    found = diagnosed(crude, tmp_path, trace(tmp_path / "a.csv", (), 21))
    assert found["verdict"] != "no_gap"


@pytest.mark.slow
@pytest.mark.smoke
def test_another_healthy_one_has_no_gap(crude: str, tmp_path: Path, healthy: list[str]) -> None:
    found = diagnosed(crude, tmp_path, trace(tmp_path / "a.csv", (), 21), reference=healthy)
    assert found["verdict"] == "no_gap"
    assert {each["floor_source"] for each in found["gap"].values()} == {"reference"}
    assert found["reference"] == [Path(each).name for each in healthy]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "beside the healthy machine in healthy11.csv" in page


@pytest.mark.slow
@pytest.mark.parametrize("cause", ["drag_error", "backlash"])
def test_what_changed_since_is_named(
    crude: str, tmp_path: Path, healthy: list[str], cause: str
) -> None:
    found = diagnosed(crude, tmp_path, trace(tmp_path / "a.csv", (cause,), 21), reference=healthy)
    assert found["effects"][0]["name"] == cause


def test_a_reference_that_is_none_is_refused_in_a_line(
    crude: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], healthy: list[str]
) -> None:
    still = tmp_path / "still.csv"
    rows = "".join(f"{k / 1000},0.1,1.0\n" for k in range(3000))
    still.write_text("time_s,torque_command_nm,motor_angle_rad\n" + rows)
    out = tmp_path / "out"
    given = ["diagnose", "--machine", crude, healthy[0], "--out", str(out)]
    assert main([*given, "--reference", str(still)]) == 2
    said = capsys.readouterr().err
    assert "reference: torque_command_nm, motor_angle_rad: not one value changes" in said
    assert said.count("\n") == 1
    assert not (out / "report.html").exists()


@pytest.mark.slow
def test_torque_is_judged_by_the_model_where_the_references_have_none(
    machine_file: Path, tmp_path: Path, healthy: list[str]
) -> None:
    rows = [line.split(",") for line in Path(healthy[0]).read_text().splitlines()]
    without = rows[0].index("torque_command_nm")
    bare = tmp_path / "bare.csv"
    bare.write_text("".join(",".join(r[:without] + r[without + 1 :]) + "\n" for r in rows))
    found = diagnosed(str(machine_file), tmp_path, healthy[1], reference=[str(bare)])
    assert "torque_nm" in found["gap"]


def moved(machine: Machine, random: np.random.Generator, bump_nm: float) -> Session:
    """Moves there and back with dry friction that no two recordings share by 2 %."""
    time_s = np.arange(0.0, 30.0, 0.02)
    place_m = np.abs(0.05 * time_s % 0.4 - 0.2)
    level_nm = 0.2 + 0.004 * random.standard_normal()
    friction_nm = level_nm + bump_nm * np.cos(10.0 * np.pi * place_m)
    torque_nm = friction_nm * np.sign(np.gradient(place_m)) + random.normal(0.0, 0.01, len(time_s))
    angle_rad = place_m / machine.transmission_ratio_m_per_rad
    return session_of(machine, SampleFrame(time_s, {ANGLE: angle_rad, TORQUE: torque_nm}))


@pytest.mark.slow
def test_a_course_of_the_same_mean_is_a_change_and_scatter_is_none(machine: Machine) -> None:
    random = np.random.default_rng(4)
    chances = []
    for bump_nm in (0.0, 0.01) * 100:
        healthy = [moved(machine, random, 0.0) for _ in range(3)]
        changes = changes_by_place(moved(machine, random, bump_nm), healthy).values()
        chances.append(stats.combine_pvalues([each.p_value for each in changes]).pvalue)
    false, right = np.mean(np.reshape(chances, (-1, 2)) < 0.05, axis=0)
    assert 0.01 <= false <= 0.1
    assert right >= 0.99
