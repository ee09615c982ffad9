"""Real machines with faults that others seeded, recorded as slowly as others record.

Cranfield (CORD 5097649): a linear actuator at 25 Hz, its current unsigned; faults are named beside
recordings of the healthy actuator. Screw actuators: 100 Hz, a data sheet and no more.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from ..bench.real_machines import ACTUATOR_TOML, DATA, SCREW_TOML, recordings, screw_actuator
from .conftest import diagnosed


def needs(folder: str) -> None:
    if not (DATA / folder).is_dir():
        pytest.skip(f"the recordings of {folder} are not here")


def answered(
    folder: Path, machine: str, trace: str, reference: Sequence[str] = ()
) -> dict[str, Any]:
    (folder / "machine.toml").write_text(machine)
    return diagnosed(folder / "machine.toml", folder, trace, reference=reference)


@pytest.mark.slow
@pytest.mark.parametrize("load", ["20", "-40"])
def test_play_behind_one_encoder_is_not_taken_for_something_else(tmp_path: Path, load: str) -> None:
    needs("cranfield")
    reference = recordings(tmp_path, "normal", load)[:3]
    for trace in recordings(tmp_path, "backlash1", load)[:2]:
        found = answered(tmp_path, ACTUATOR_TOML, trace, reference)
        assert all(each["probability"] < 0.9 for each in found["effects"])
        assert "one encoder only" in found["not_judged_reasons"]["backlash"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "LinA_no-load-square-wave-full-travel-0.5Hz",
        "LinA_no-pp-sine-sweep-10mm-0.5Hz",
        "LinA_pp-sine-sweep-10mm-0.5Hz",
        "LinA_pp-square-wave-10mm-0.5Hz",
    ],
)
def test_a_screw_actuator_with_a_data_sheet_has_an_answer(tmp_path: Path, name: str) -> None:
    needs("screw_actuators")
    found = answered(tmp_path, SCREW_TOML, screw_actuator(tmp_path / "a.csv", name))
    assert bool(found["reasons"]) == (found["verdict"] == "bad_data")
    for each in found["effects"]:
        assert each["shrink"]["high"] > 0.0
        assert each["channel"] == "torque_nm"
