"""A real axis with effects withheld: the baseline knows mass and viscous friction only.

Published values: Janot, Gautier and Brunot, Data Set and Reference Models of EMPS, 2019.
"""

from pathlib import Path

import pytest

from ..conftest import diagnosed, torque_gap

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data" / "emps"
RATIO = 0.0025 / (2.0 * 3.141592653589793)
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the EMPS recordings are not here")


@pytest.mark.slow
def test_drag_and_asymmetry_are_found_and_help_on_the_validation_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = str(ROOT / "deploy" / "emps.toml")
    document = diagnosed(machine, tmp_path, str(DATA / "emps_estimation.csv"))
    named = {each["name"]: each for each in document["effects"]}
    assert document["verdict"] == "explained"
    assert min(named[name]["probability"] for name in ("drag_error", "load_offset")) > 0.9
    assert not {"warmup", "thermal_growth"} & named.keys()
    drag = named["drag_error"]["entries"][0]["change_nm"]
    assert drag == pytest.approx(20.3935 * RATIO, rel=0.02)
    offset = named["load_offset"]["entries"][0]
    assert sum(offset.values()) == pytest.approx(-3.1648 * RATIO, rel=0.05)
    assert {"backlash", "thermal_growth", "timestamp_skew"} <= set(document["not_judged"])
    assert list(document["gap"]) == ["torque_nm"]
    pulses = str(DATA / "emps_validation_pulses.csv")
    learned = torque_gap(tmp_path / "out" / "augmented.toml", pulses, capsys)
    assert learned < 0.2 * torque_gap(machine, pulses, capsys)
