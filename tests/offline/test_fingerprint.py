"""The fingerprint command's files: JSON, a page that stands alone, and what is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import load_machine
from edge_service.fingerprint.result import FingerprintError, read_fingerprint
from edge_service.messages.samples import SETPOINT
from edge_service.offline.fingerprint import fingerprint
from edge_service.offline.report.fingerprint_page import WORDING, plain
from edge_service.offline.report.quantities import estimate
from edge_service.offline.simulate import SimulationSettings, simulate, simulate_session
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import read_trace
from edge_service.regression.interval_estimate import IntervalEstimate

ROOT = Path(__file__).parents[2]
BENCH = ROOT / "deploy" / "machine.toml"


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bench with guides that hold the table, so that play shows at reversals."""
    path = tmp_path_factory.mktemp("machine") / "rubbing.toml"
    text = BENCH.read_text()
    path.write_text(text.replace("[model]", "[model]\nguide_force_n = 150.0", 1))
    return path


@pytest.fixture(scope="module")
def walked(rubbing: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The thesis' five steps: test, parse, model and store; change something; compare."""
    folder = tmp_path_factory.mktemp("walk")
    machine = load_machine(rubbing)
    motions = ("acceleration", "reversals")
    for motion in motions:
        settings = SimulationSettings(motion, seed=1)
        simulate(machine, settings, folder / f"healthy_{motion}.parquet")
        worn = SimulationSettings(motion, effects=("backlash:width_m=8e-6",), seed=2)
        simulate(machine, worn, folder / f"worn_{motion}.parquet")
    fingerprint(rubbing, [folder / f"healthy_{m}.parquet" for m in motions], folder / "healthy")
    line = fingerprint(
        rubbing,
        [folder / f"worn_{m}.parquet" for m in motions],
        folder / "worn",
        folder / "healthy" / "fingerprint.json",
    )
    (folder / "summary.txt").write_text(line.words)
    return folder


def test_the_five_steps_name_what_was_changed(walked: Path) -> None:
    document = json.loads((walked / "worn" / "fingerprint.json").read_text())
    assert document["schema"] == "fingerprint/1"
    changes = {
        change["figure"]: change
        for change in document["changes"]
        if change["significant"] and change["material"]
    }
    lost = changes["backlash.lost_motion_at_400_mm_m"]
    assert lost["change"] == pytest.approx(8e-6, rel=0.03)
    assert {name.partition(".")[0] for name in changes} <= {"backlash", "reversal_error"}
    said = (walked / "summary.txt").read_text().splitlines()[0]
    assert re.search(r"against the baseline: backlash(: lost motion)? at \d+ mm [78]\.\d+ µm", said)


def test_every_section_says_what_it_has_or_needs(walked: Path) -> None:
    sections = json.loads((walked / "healthy" / "fingerprint.json").read_text())["sections"]
    assert sections.keys() == WORDING.keys() - {"friction_runs"}
    for section in sections.values():
        assert section["motion"]
        assert (section["status"] == "determined") == (section["reason"] == "")
    assert sections["friction"]["status"] == "undetermined"
    assert sections["signature"]["motion"] == "signature"


def test_the_page_stands_alone_and_shows_the_baseline(walked: Path) -> None:
    page = (walked / "worn" / "report.html").read_text()
    assert "Against the baseline: backlash" in page
    assert "baseline, lost motion" in page
    assert "edge-service motion friction" in page
    assert not re.search(r"<(script|link|img)|src=|url\(http|\bnan\b|\binf\b", page)
    assert all(f'id="{name}"' in page for name in WORDING.keys() - {"friction_runs"})


def test_same_recordings_give_the_same_bytes(walked: Path, rubbing: Path, tmp_path: Path) -> None:
    traces = [walked / f"healthy_{motion}.parquet" for motion in ("reversals", "acceleration")]
    fingerprint(rubbing, traces, tmp_path)
    for name in ("fingerprint.json", "report.html"):
        assert (tmp_path / name).read_bytes() == (walked / "healthy" / name).read_bytes()


def test_nothing_that_changed_is_said_with_what_was_compared(
    walked: Path, rubbing: Path, tmp_path: Path
) -> None:
    old = walked / "healthy" / "fingerprint.json"
    said = fingerprint(rubbing, [walked / "healthy_acceleration.parquet"], tmp_path, old)
    line = said.words.splitlines()[0]
    changes = json.loads((tmp_path / "fingerprint.json").read_text())["changes"]
    assert changes and not any(each["significant"] and each["material"] for each in changes)
    assert f"nothing has changed against the baseline ({len(changes)} figures of " in line
    assert all(plain(each["figure"].partition(".")[0]) in line for each in changes)
    none = json.loads(old.read_text())
    for section in none["sections"].values():
        section |= {"status": "undetermined", "reason": "left out", "figures": {}}
    (tmp_path / "none.json").write_text(json.dumps(none))
    said = fingerprint(
        rubbing, [walked / "healthy_acceleration.parquet"], tmp_path / "out", tmp_path / "none.json"
    )
    assert "cannot tell, no figure is determined in both" in said.words


def test_bad_input_is_one_line_and_leaves_nothing(walked: Path, tmp_path: Path) -> None:
    trace = walked / "healthy_reversals.parquet"
    other = tmp_path / "y.toml"
    other.write_text(BENCH.read_text().replace('name = "X"', 'name = "Y"'))
    old = walked / "healthy" / "fingerprint.json"
    out = tmp_path / "out"
    for machine_file, traces, baseline, expected in (
        (BENCH, [], None, "no recording given"),
        (BENCH, [trace, trace], None, "two recordings are called"),
        (BENCH, [trace], tmp_path / "none.json", "cannot be read"),
        (BENCH, [trace], trace, "not JSON"),
        (other, [trace], old, "of axis X, expected axis Y"),
    ):
        with pytest.raises(FingerprintError, match=expected) as caught:
            fingerprint(machine_file, traces, out, baseline)
        assert "\n" not in str(caught.value)
    with pytest.raises(TraceError, match="no such file"):
        fingerprint(BENCH, [tmp_path / "none.csv"], out)
    assert not out.exists()


@pytest.mark.parametrize(
    ("figure", "text"),
    [
        (IntervalEstimate(8.0e-6, 7.6e-6, 8.4e-6, "m", 9.0), "8.00 µm (7.60 to 8.40)"),
        (
            IntervalEstimate(1.5e-3, 1.49e-3, 1.51e-3, "kg m^2", 9.0),
            "15.00 kg cm² (14.90 to 15.10)",
        ),
        (IntervalEstimate(2e-10, -1e-10, 5e-10, "m", 9.0), "0.000 µm (-0.000 to 0.001)"),
        (IntervalEstimate(float("nan"), -np.inf, np.inf, "N", 9.0), "undetermined"),
        (IntervalEstimate(float("nan"), 0.0, 1.0, "N", 9.0), "0.00 to 1.00 N"),
        (IntervalEstimate(0.0, 0.0, 0.0, "N", 9.0), "0.0 N (0.0 to 0.0)"),
    ],
)
def test_numbers_are_shown_with_digits_that_they_have(figure: IntervalEstimate, text: str) -> None:
    assert estimate(figure).startswith(text)
    assert plain("stiffness.stiffness_at_160_mm_n_per_m") == "stiffness at 160 mm"
    assert plain("coulomb_nm") == "Coulomb"


COLD_NM, WARM_S = 0.08, 200.0


def commanded_mean_excess_nm(trace: Path, rpm: float) -> float:
    """Mean of the put-in excess while the setpoint runs at a speed of the friction test."""
    frame = read_trace(trace)
    speed = np.gradient(frame.channels[SETPOINT], frame.time_s)
    cruise = np.abs(np.abs(speed) - rpm / 60.0 * 0.02) < 1e-5
    return float(np.mean(COLD_NM * np.exp(-frame.time_s[cruise] / WARM_S)))


@pytest.mark.slow
def test_the_warm_up_study_comes_out_of_the_fingerprint(rubbing: Path, tmp_path: Path) -> None:
    """Friction tests with a warm-up cycle between (Figure 5.11), as the README has it."""
    motions = ("friction", "warmup:duration_s=60", "friction", "warmup:duration_s=60", "friction")
    effects = (f"warmup:excess_nm={COLD_NM},time_constant_s={WARM_S}",)
    settings = SimulationSettings(effects=effects)
    runs = tmp_path / "runs"
    simulate_session(load_machine(rubbing), settings, motions, runs)
    summary = fingerprint(rubbing, sorted(runs.iterdir()), tmp_path)
    assert "Friction from test to test: change at 300 rpm -0.0" in summary.words
    section = read_fingerprint(tmp_path / "fingerprint.json").sections["friction_runs"]
    first, last = (runs / f"{k}_friction.parquet" for k in ("01", "05"))
    assert [each.name for each in section.curves] == [first.name, "03_friction.parquet", last.name]
    for rpm in (120, 300, 1200):
        change = commanded_mean_excess_nm(last, rpm) - commanded_mean_excess_nm(first, rpm)
        found = section.figures[f"change_at_{rpm}_rpm_nm"]
        assert found.value == pytest.approx(change, rel=0.05)
        assert found.high < 0.0
    assert section.figures["change_at_300_rpm_nm"].holds(
        commanded_mean_excess_nm(last, 300) - commanded_mean_excess_nm(first, 300)
    )
    page = (tmp_path / "report.html").read_text()
    assert 'id="friction_runs"' in page
    assert all(f"{k:02}_friction" in page for k in (1, 3, 5))
