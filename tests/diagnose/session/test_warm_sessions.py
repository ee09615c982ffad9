"""An axis that is recorded at several temperatures, and later at another one.

Friction falls by 1 / (1 + dT / T0), which is no law of the library; the housing's sensor is noisy.
"""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.messages.samples import Floats

from ..conftest import recorded

COLD_C, SPAN_K = 21.0, 10.0
DRY_NM, VISCOUS_NM_S_PER_RAD = 0.25, 1.5e-3
"""Of the axis' friction so much depends on its temperature."""
RECORDED_C = (26.0, 22.0, 30.0)
LATER_C = 27.5


def trace(folder: Path, seed: int, temperature_c: float) -> str:
    columns = dict(recorded((), seed=seed).columns)
    time_s: Floats = columns["time_s"]
    random = np.random.default_rng(seed)
    warmth_c = temperature_c + 0.5 * (1.0 - np.exp(-time_s / 60.0))
    thinner = 1.0 / (1.0 + (warmth_c - COLD_C) / SPAN_K) - 1.0
    speed = np.gradient(columns["motor_angle_rad"], time_s)
    moving = np.abs(speed) > 0.5
    rubbed = DRY_NM * np.sign(speed) * moving + VISCOUS_NM_S_PER_RAD * speed
    columns["torque_command_nm"] = columns["torque_command_nm"] + thinner * rubbed
    columns["temperature_c"] = warmth_c + 0.05 * random.standard_normal(len(time_s))
    path = folder / f"at_{temperature_c:g}.csv"
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return str(path)


@pytest.mark.slow
def test_friction_that_falls_with_the_temperature_is_foretold_at_another_one(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    traces = [trace(tmp_path, 3 + k, each) for k, each in enumerate(RECORDED_C)]
    out = tmp_path / "out"
    assert main(["diagnose", "--machine", str(machine_file), *traces, "--out", str(out)]) == 0
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] in ("explained", "ambiguous")
    assert "warmup" in [each["name"] for each in found["effects"]]
    later = trace(tmp_path, 9, LATER_C)
    gaps = []
    for file in (machine_file, out / "augmented.toml"):
        capsys.readouterr()
        assert main(["gap", "--machine", str(file), later, "--json"]) == 0
        gaps.append(json.loads(capsys.readouterr().out)["torque_nm"])
    assert gaps[1] < 0.3 * gaps[0]
