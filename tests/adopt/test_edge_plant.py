"""An Industrial Edge recording of a plant of known preload, from `adopt` to `estimate`."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from ..foreign_plant import Machine, Recording, axis_case, part_programme, simulate
from .test_real_machines import said

PLANT = Machine()
SHEET = (
    *("--lead", 1e3 * PLANT.lead_m),
    *("--screw", f"C{PLANT.dynamic_load_rating_n:g} P{PLANT.preload_n:g}"),
    *("--set", f"preload_drag_nm={PLANT.preload_drag_nm!r}"),
    *("--set", f"nut_stiffness_n_per_m={PLANT.nut_stiffness_n_per_m!r}"),
)


def edge_file(recording: Recording, path: Path) -> Path:
    """Every second sample, 500 Hz, under the names and in the units of the control."""
    columns = {name: np.asarray(values)[::2] for name, values in recording.columns.items()}
    rows = zip(
        np.arange(len(columns["time_s"])) + 5000,
        columns["motor_angle_rad"] * PLANT.lead_rad * 1e3,
        columns["table_position_m"] * 1e3,
        columns["torque_command_nm"],
        strict=True,
    )
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["CYCLE", "ENC1_POS|1", "ENC2_POS|1", "TORQUE|1"])
        for count, *values in rows:
            writer.writerow([count, *("" if math.isnan(v) else f"{v:.9g}" for v in values)])
    return path


def plant_run(
    seed: int, duration_s: float, percent: float | None = None, *, parts: bool = False
) -> Recording:
    """Run of axis 61: random moves, or the moves of a part programme."""
    rng = np.random.default_rng(seed)
    moves = part_programme(rng, duration_s, PLANT.stroke_m) if parts else None
    case = axis_case(
        percent, duration_s=duration_s, seed=seed, axis_seed=61, machine=PLANT, setpoint_m=moves
    )
    return simulate(case)


def errors(estimates: Path, recording: Recording) -> list[float]:
    """Distance of the true preload outside each interval, points; negative within."""
    truth = recording.truth
    outside = []
    with estimates.open() as file:
        for row in csv.DictReader(file):
            if row["status"] == "estimated" and row["preload_percent"]:
                true = np.interp(float(row["time_s"]), truth["time_s"], truth["preload_percent"])
                outside.append(max(float(row["low"]) - true, true - float(row["high"])))
    return outside


@pytest.mark.slow
@pytest.mark.parametrize("parts", [False, True], ids=["moves", "programme"])
@pytest.mark.parametrize("mass_kg", [None, PLANT.table_mass_kg], ids=["guessed", "stated"])
def test_preload_is_held_from_adopt_to_estimate(
    mass_kg: float | None, parts: bool, tmp_path: Path
) -> None:
    """No test run: production alone teaches it, with the mass stated or guessed."""
    options = [*SHEET, *(() if mass_kg is None else ("--set", f"table_mass_kg={mass_kg!r}"))]
    healthy = edge_file(plant_run(601, 120.0, parts=parts), tmp_path / "healthy.csv")
    proposed, learned = tmp_path / "proposed.toml", tmp_path / "learned.toml"
    said("adopt", healthy, "--axis-number", 1, *options, "--out", proposed)
    said("commission", "--machine", proposed, healthy, "--out", learned)
    for percent in (None, 0.5 * PLANT.preload_percent):
        recording = plant_run(602, 60.0, percent, parts=parts)
        trace = edge_file(recording, tmp_path / "later.csv")
        out = tmp_path / "estimates.csv"
        said("estimate", "--machine", learned, trace, "--out", out)
        outside = errors(out, recording)
        assert len(outside) > 300
        assert np.mean(np.array(outside) <= 0.0) >= 0.9
        assert max(outside) <= 0.5
