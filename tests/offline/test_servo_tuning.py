"""`edge-service fingerprint` of a servo tuning: modes and inertia as page and JSON."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.offline.simulate import SimulationSettings, simulate
from tests.recordings.tuning_files import measurement, tuning

FREQUENCY = np.geomspace(1.0, 500.0, 300)
NOTCH_HZ, PEAK_HZ, INERTIA = 40.0, 60.0, 0.1


def _response() -> np.ndarray:
    s = 2j * math.pi * FREQUENCY
    notch, peak = (2.0 * math.pi * each for each in (NOTCH_HZ, PEAK_HZ))
    above = (s / notch) ** 2 + 0.06 * s / notch + 1.0
    below = (s / peak) ** 2 + 0.06 * (PEAK_HZ / NOTCH_HZ) * s / peak + 1.0
    return above / below / (INERTIA * s)


def _figures(out: Path) -> dict[str, dict]:
    document = json.loads((out / "fingerprint.json").read_text())
    return document["sections"]["frequency_response"]["figures"]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "AST_AX1.xml"
    stated = {"m_dTotalInertia": 0.11, "m_uNumberOfAverages": 20}
    path.write_text(tuning(FREQUENCY, _response(), np.full(300, 0.999), stated))
    return path


def test_modes_and_inertia_are_written_and_said(source: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert main(["fingerprint", str(source), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "axis AX1: " in said
    assert "the control states: total inertia 0.11 kg m2" in said
    figures = _figures(out)
    assert figures["antiresonance_hz"]["value"] == pytest.approx(NOTCH_HZ, rel=0.01)
    assert figures["resonance_hz"]["value"] == pytest.approx(PEAK_HZ, rel=0.01)
    assert figures["response_inertia_kg_m2"]["value"] == pytest.approx(INERTIA, rel=0.01)
    assert "the control states 0.11 kg m2" in (out / "report.html").read_text()
    assert "<svg" in (out / "report.html").read_text()


def test_json_is_the_document_and_a_baseline_names_what_it_compares(
    source: Path, tmp_path: Path, capsys
) -> None:
    assert main(["fingerprint", str(source), "--out", str(tmp_path / "then"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "fingerprint/1"
    then = str(tmp_path / "then" / "fingerprint.json")
    arguments = ["fingerprint", str(source), "--out", str(tmp_path / "now"), "--baseline", then]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "nothing has changed against the baseline (10 figures of frequency response)" in said


def test_a_baseline_of_another_axis_is_refused(source: Path, tmp_path: Path, capsys) -> None:
    assert main(["fingerprint", str(source), "--out", str(tmp_path / "then")]) == 0
    other = tmp_path / "other.xml"
    other.write_text(source.read_text().replace(">AX1<", ">AX2<"))
    then = str(tmp_path / "then" / "fingerprint.json")
    capsys.readouterr()
    arguments = ["fingerprint", str(other), "--out", str(tmp_path / "now"), "--baseline", then]
    assert main(arguments) == 2
    assert "of axis AX1, expected axis AX2" in capsys.readouterr().err


def test_a_measurement_has_modes_and_no_inertia(tmp_path: Path, capsys) -> None:
    source, out = tmp_path / "speed.xml", tmp_path / "out"
    power = np.ones(300, dtype=complex)
    output = np.abs(_response()) ** 2 * power
    source.write_text(measurement(FREQUENCY, [output, 0.9995 * output / _response(), power]))
    assert main(["fingerprint", str(source), "--out", str(out)]) == 0
    figures = _figures(out)
    assert figures["antiresonance_hz"]["value"] == pytest.approx(NOTCH_HZ, rel=0.01)
    assert not any("inertia" in name for name in figures)


def test_an_inertia_far_from_the_one_stated_is_not_told(source: Path, tmp_path: Path) -> None:
    source.write_text(source.read_text().replace(">0.11<", ">0.00011<"))
    assert main(["fingerprint", str(source), "--out", str(tmp_path / "out")]) == 0
    figures = _figures(tmp_path / "out")
    assert figures["response_inertia_kg_m2"]["value"] is None
    assert "in doubt" in figures["response_inertia_kg_m2"]["note"]
    assert figures["stiffness_nm_per_rad"]["value"] is None
    assert figures["resonance_hz"]["value"] == pytest.approx(PEAK_HZ, rel=0.01)


def test_a_linear_motor_has_modes_and_no_inertia(source: Path, tmp_path: Path) -> None:
    linear = '<boolean name="m_bMotorIsRotary">false</boolean><LinkedList name="m_listMech'
    source.write_text(source.read_text().replace('<LinkedList name="m_listMech', linear))
    assert main(["fingerprint", str(source), "--out", str(tmp_path / "out")]) == 0
    assert not any("inertia" in name for name in _figures(tmp_path / "out"))


def test_what_is_no_response_of_a_mass_is_said(tmp_path: Path, capsys) -> None:
    source, out = tmp_path / "loop.xml", tmp_path / "out"
    loop = 1.0 / (1.0 + 1j * FREQUENCY / 100.0)
    source.write_text(tuning(FREQUENCY, loop, np.full(300, 0.99)))
    assert main(["fingerprint", str(source), "--out", str(out)]) == 0
    assert "undetermined, no response of speed to torque" in capsys.readouterr().out


def test_a_tuning_stands_beside_recordings(source: Path, tmp_path: Path) -> None:
    machine = load_machine(DEFAULT_MACHINE)
    trace, out = tmp_path / "x.parquet", tmp_path / "out"
    simulate(machine, SimulationSettings("friction", duration_s=8.0), trace)
    assert main(["fingerprint", str(trace), str(source), "--out", str(out)]) == 0
    found = json.loads((out / "fingerprint.json").read_text())
    assert (found["machine"], found["sources"]) == (machine.axis.name, ["AST_AX1.xml", "x.parquet"])
    assert found["modes"]
    assert "friction" in found["sections"]
    assert _figures(out)["resonance_hz"]["value"] == pytest.approx(PEAK_HZ, rel=0.01)
