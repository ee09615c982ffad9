"""Machines that others measured: what their makers state is found, and nothing beside it."""

import math
import tomllib
from pathlib import Path

import pytest

from edge_service.checks.columns.guess import Known
from edge_service.config import load_machine
from edge_service.offline.adopt import adopt

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no recordings beside the checkout")


def columns_of(path: Path) -> dict[str, dict[str, object]]:
    found = tomllib.loads(path.read_text("utf-8"))["columns"]
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("name", ["normal", "lackLubrication1", "backlash1"])
def test_cranfield_reads_as_its_makers_describe_it(name: str, tmp_path: Path) -> None:
    out = tmp_path / "m.toml"
    text = adopt([DATA / "cranfield" / f"{name}.csv"], out, known=Known(0.005, 1.0)).words
    assert "has no sign" in text and "starts anew" in text and "inertia: no" in text
    found = columns_of(out)
    assert found["table_position_m"] == {
        "column": "set_point",
        "scale": 0.001,
        "minus": "position_error",
    }
    assert found["torque_command_nm"]["direction"] == "set_point"
    assert found["time_s"] == {"column": "time", "scale": 1.0}


def test_emps_gives_its_published_mass_and_friction(tmp_path: Path) -> None:
    out, ratio = tmp_path / "m.toml", 0.0025 / (2.0 * math.pi)
    known = Known(0.0025, 35.15065 * ratio)
    adopt([DATA / "emps" / "emps_estimation.csv"], out, known=known)
    model = load_machine(out).model
    assert model.preload_drag_nm is not None
    assert model.inertia_kg_m2.value / ratio**2 == pytest.approx(95.1089, rel=0.02)
    assert model.preload_drag_nm.value / ratio == pytest.approx(20.3935, rel=0.05)


def test_the_mills_rows_are_a_tenth_of_a_second_apart(tmp_path: Path) -> None:
    path = DATA / "smart_cnc_mill" / "experiment_06.csv"
    for number, name in ((1, "X1"), (2, "Y1")):
        out = tmp_path / f"{name}.toml"
        adopt([path], out, axis_number=number, known=Known(0.01, 0.06))
        found = columns_of(out)
        assert found["time_s"] == {"column": "#row", "scale": 0.1}
        assert found["table_position_m"] == {"column": f"{name}_ActualPosition", "scale": 0.001}
        assert load_machine(out).axis.name == name
