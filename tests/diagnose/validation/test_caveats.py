"""Bounds of a verdict are stated: noise that hides faults, and a remainder beside the causes."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.diagnose.pipeline import caveats_of
from edge_service.diagnose.result import ChannelGap, Diagnosis, ReplayStatus, Verdict
from edge_service.offline.report.diagnosis_page import summary

from ...bench.real_machines import written
from ..conftest import diagnosed, recorded


def noisy(
    machine_file: Path, folder: Path, noise_nm: float, causes: tuple[str, ...] = ()
) -> dict[str, Any]:
    columns = dict(recorded(causes, 3).columns)
    noise = np.random.default_rng(5).normal(0.0, noise_nm, len(columns["time_s"]))
    # as slow as the comparison, so that its low-pass does not take it away
    slow = np.convolve(noise, np.ones(40) / np.sqrt(40.0), "same")
    columns["torque_command_nm"] = columns["torque_command_nm"] + slow
    document = diagnosed(machine_file, folder, written(folder / "a.csv", columns))
    return document | {"page": (folder / "out" / "report.html").read_text()}


@pytest.mark.slow
def test_noise_as_large_as_the_torque_is_no_all_clear(machine_file: Path, tmp_path: Path) -> None:
    found = noisy(machine_file, tmp_path, 2.0)
    assert found["verdict"] == "unknown"
    assert all(each["probability"] <= 0.5 for each in found["effects"])
    (line,) = found["caveats"]
    assert "a fault of that size would go unnoticed" in line
    assert "This recording cannot answer" in found["page"]
    assert line[1:] in found["page"]


@pytest.mark.slow
def test_a_gap_beyond_the_noise_is_not_hidden_by_it(machine_file: Path, tmp_path: Path) -> None:
    crude = tmp_path / "crude.toml"
    crude.write_text(re.sub("(viscous.*) = .*", r"\1 = 0.1", machine_file.read_text()))
    found = noisy(crude, tmp_path, 2.0)
    assert any("unnoticed" in each for each in found["caveats"])
    assert "This recording cannot answer" not in found["page"]


@pytest.mark.slow
def test_little_noise_is_an_all_clear(machine_file: Path, tmp_path: Path) -> None:
    found = noisy(machine_file, tmp_path, 1e-3)
    assert found["verdict"] == "no_gap"
    assert not any("unnoticed" in each for each in found["caveats"])


@pytest.mark.parametrize(
    ("verdict", "after", "stated"),
    [
        (Verdict.EXPLAINED, 0.05, True),
        (Verdict.AMBIGUOUS, 0.05, True),
        (Verdict.EXPLAINED, 0.02, False),
        (Verdict.UNKNOWN, 0.05, False),
        (Verdict.NO_GAP, 0.02, True),
    ],
)
def test_a_remainder_that_matters_is_reported(verdict: Verdict, after: float, stated: bool) -> None:
    gap = ChannelGap(before=0.2, after=after, noise_floor=0.018, tolerance=0.014, unit="N m")
    found = caveats_of({"torque_nm": gap}, {"torque_nm": after}, 1.0, verdict)
    assert bool(found) == stated
    if stated:
        left = "0.199 N m beyond" if verdict is Verdict.NO_GAP else "0.0466 N m beyond"
        assert found[0].startswith(f"torque: {left} the floor")


@pytest.mark.parametrize("verdict", list(Verdict))
@pytest.mark.parametrize(("kept", "reference"), [(0.21, ()), (0.1, ()), (None, ()), (0.21, ("a",))])
def test_only_a_healthy_axis_is_as_it_was_commissioned(verdict, kept, reference):
    """The verdict is the last one, whatever later steps make of the first."""
    known = {"noise_floor": 0.018, "tolerance": 0.25, "commissioned": kept}
    gap = {"torque_nm": ChannelGap(before=0.2, after=0.2, unit="N m", **known)}
    replay = ReplayStatus(possible=True, reason=None)
    found = Diagnosis(verdict=verdict, gap=gap, replay=replay, reference=reference)
    said = summary(found, Path("out"), 1.0)
    is_kept = verdict is Verdict.NO_GAP and kept == 0.21 and not reference
    assert said.startswith("Machine and model differ about as much as at") == is_kept
    assert ("torque: the gap is about what it was at commissioning (0.21 N m)" in said) == is_kept


@pytest.mark.slow
def test_a_noisy_torque_hides_no_backlash(machine_file: Path, tmp_path: Path) -> None:
    found = noisy(machine_file, tmp_path, 2.0, ("backlash",))
    (play,) = [each for each in found["effects"] if each["channel"] == "transmission_m"]
    assert play["name"] == "backlash"
    assert play["probability"] > 0.9
    assert found["verdict"] in ("explained", "ambiguous")
    assert all(each is play or each["probability"] <= 0.5 for each in found["effects"])
    assert "a fault of that size would go unnoticed" in found["caveats"][0]
