"""`edge-service response`: a servo tuning in, modes with page, picture and JSON out."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from tests.recordings.tuning_files import measurement, tuning

REAL = Path(__file__).parents[3] / "shared" / "data" / "sinumerik_ast" / "AST_AX7.xml"
FREQUENCY = np.geomspace(1.0, 500.0, 300)
NOTCH_HZ, PEAK_HZ, INERTIA = 40.0, 60.0, 0.1


def _response() -> np.ndarray:
    s = 2j * math.pi * FREQUENCY
    notch, peak = (2.0 * math.pi * each for each in (NOTCH_HZ, PEAK_HZ))
    above = (s / notch) ** 2 + 0.06 * s / notch + 1.0
    below = (s / peak) ** 2 + 0.06 * (PEAK_HZ / NOTCH_HZ) * s / peak + 1.0
    return above / below / (INERTIA * s)


def _figures(out: Path) -> dict[str, dict]:
    document = json.loads((out / "response.json").read_text())
    return document["sections"]["frequency_response"]["figures"]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "AST_AX1.xml"
    stated = {"m_dTotalInertia": 0.11, "m_uNumberOfAverages": 20}
    path.write_text(tuning(FREQUENCY, _response(), np.full(300, 0.999), stated))
    return path


def test_modes_and_inertia_are_written_and_said(source: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out"
    assert main(["response", str(source), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "axis AX1, AST_AX1.xml" in said
    assert "the control states: total inertia 0.11 kg m2" in said
    figures = _figures(out)
    assert figures["antiresonance_hz"]["value"] == pytest.approx(NOTCH_HZ, rel=0.01)
    assert figures["resonance_hz"]["value"] == pytest.approx(PEAK_HZ, rel=0.01)
    assert figures["response_inertia_kg_m2"]["value"] == pytest.approx(INERTIA, rel=0.01)
    assert "the control states 0.11 kg m2" in (out / "report.html").read_text()
    assert (out / "frequency_response.png").read_bytes().startswith(b"\x89PNG")


def test_a_fingerprint_takes_a_tuning_as_it_takes_recordings(source: Path, tmp_path: Path) -> None:
    then, now = tmp_path / "then", tmp_path / "now"
    assert main(["fingerprint", str(source), "--out", str(then)]) == 0
    baseline = ["--baseline", str(then / "fingerprint.json")]
    assert main(["fingerprint", str(source), *baseline, "--out", str(now)]) == 0
    found = json.loads((now / "fingerprint.json").read_text())
    figures = found["sections"]["frequency_response"]["figures"]
    assert figures["resonance_hz"]["value"] == pytest.approx(PEAK_HZ, rel=0.01)


def test_json_is_the_document_and_a_baseline_names_what_it_compares(
    source: Path, tmp_path: Path, capsys
) -> None:
    assert main(["response", str(source), "--out", str(tmp_path / "then"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["schema"] == "fingerprint/1"
    then = str(tmp_path / "then" / "response.json")
    arguments = ["response", str(source), "--out", str(tmp_path / "now"), "--baseline", then]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "changed against the baseline: nothing, of frequency response: antiresonance" in said


def test_a_baseline_of_another_axis_is_refused(source: Path, tmp_path: Path, capsys) -> None:
    assert main(["response", str(source), "--out", str(tmp_path / "then")]) == 0
    other = tmp_path / "other.xml"
    other.write_text(source.read_text().replace(">AX1<", ">AX2<"))
    then = str(tmp_path / "then" / "response.json")
    capsys.readouterr()
    arguments = ["response", str(other), "--out", str(tmp_path / "now"), "--baseline", then]
    assert main(arguments) == 2
    assert "of axis AX1, expected axis AX2" in capsys.readouterr().err


def test_a_measurement_has_modes_and_no_inertia(tmp_path: Path, capsys) -> None:
    source, out = tmp_path / "speed.xml", tmp_path / "out"
    power = np.ones(300, dtype=complex)
    output = np.abs(_response()) ** 2 * power
    source.write_text(measurement(FREQUENCY, [output, 0.9995 * output / _response(), power]))
    assert main(["response", str(source), "--out", str(out)]) == 0
    figures = _figures(out)
    assert figures["antiresonance_hz"]["value"] == pytest.approx(NOTCH_HZ, rel=0.01)
    assert not any("inertia" in name for name in figures)


def test_an_inertia_far_from_the_one_stated_is_not_told(source: Path, tmp_path: Path) -> None:
    source.write_text(source.read_text().replace(">0.11<", ">0.00011<"))
    assert main(["response", str(source), "--out", str(tmp_path / "out")]) == 0
    figures = _figures(tmp_path / "out")
    assert figures["response_inertia_kg_m2"]["value"] is None
    assert "in doubt" in figures["response_inertia_kg_m2"]["note"]
    assert figures["stiffness_nm_per_rad"]["value"] is None
    assert figures["resonance_hz"]["value"] == pytest.approx(PEAK_HZ, rel=0.01)


def test_a_linear_motor_has_modes_and_no_inertia(source: Path, tmp_path: Path) -> None:
    linear = '<boolean name="m_bMotorIsRotary">false</boolean><LinkedList name="m_listMech'
    source.write_text(source.read_text().replace('<LinkedList name="m_listMech', linear))
    assert main(["response", str(source), "--out", str(tmp_path / "out")]) == 0
    assert not any("inertia" in name for name in _figures(tmp_path / "out"))


def test_what_is_no_response_of_a_mass_is_said(tmp_path: Path, capsys) -> None:
    source, out = tmp_path / "loop.xml", tmp_path / "out"
    loop = 1.0 / (1.0 + 1j * FREQUENCY / 100.0)
    source.write_text(tuning(FREQUENCY, loop, np.full(300, 0.99)))
    assert main(["response", str(source), "--out", str(out)]) == 0
    assert "undetermined, no response of speed to torque" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "nothing: the file is empty"),
        (b"PK\3\4", "a zip archive"),
        (b"<a/>", "XML document <a>"),
        (b"\xff\xfe<\0", "UTF-16"),
        (b"time_s,x\n0,1\n", "a recording, text (CSV)"),
        (b"<traceSession>", "a recording, SINUMERIK trace XML"),
        (b"<DynamicModelAxisController>", "cut off or damaged"),
    ],
)
def test_what_is_no_tuning_is_one_line_and_status_2(content, says, tmp_path, capsys) -> None:
    source = tmp_path / "a.xml"
    source.write_bytes(content)
    assert main(["response", str(source), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert says in said
    assert not (tmp_path / "out").exists()


def test_a_folder_and_a_missing_file_are_one_line(tmp_path: Path, capsys) -> None:
    for source in (tmp_path, tmp_path / "missing.xml"):
        assert main(["response", str(source), "--out", str(tmp_path / "out")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.skipif(not REAL.exists(), reason="the servo tuning is not here")
def test_a_real_spindle_has_the_modes_of_its_raw_peaks(tmp_path: Path) -> None:
    """Raw peaks 41.5 and 59.1 Hz on frequencies 1.6 and 1.9 Hz apart; the control states .147."""
    out = tmp_path / "out"
    assert main(["response", str(REAL), "--out", str(out)]) == 0
    figures = _figures(out)
    assert figures["antiresonance_hz"]["value"] == pytest.approx(41.5, abs=0.8)
    assert figures["resonance_hz"]["value"] == pytest.approx(59.1, abs=1.0)
    assert figures["response_inertia_kg_m2"]["value"] == pytest.approx(0.147, rel=0.1)
    assert figures["motor_inertia_kg_m2"]["value"] == pytest.approx(0.076, rel=0.1)
    assert figures["table_share"]["value"] == pytest.approx(0.48, abs=0.02)
    document = json.loads((out / "response.json").read_text())
    assert document["stated"]["total_inertia_kg_m2"] == pytest.approx(0.14675, rel=1e-4)
