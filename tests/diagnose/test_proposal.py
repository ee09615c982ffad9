"""Motion that decides, how sure it would be, and all that a motion can show."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.diagnose.experiment import DECISIVE, healthy_session, propose
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine

from .conftest import runs


@pytest.fixture(scope="module")
def bench() -> Machine:
    return load_machine(DEFAULT_MACHINE)


def test_a_healthy_axis_has_settled_and_stands_for_a_long_session(bench: Machine) -> None:
    """A recording that begins in motion starts the simulated axis from rest, behind it."""
    time_s = np.arange(7000) * 0.01
    way_m = 0.3 + 0.2 * np.sin(time_s + 1.0)
    channels = {
        "motor_angle_rad": way_m / bench.transmission_ratio_m_per_rad,
        "torque_command_nm": 0.4 * np.cos(time_s + 1.0),
    }
    (run,) = runs(bench, SampleFrame(time_s, channels))
    healthy = healthy_session(bench, [run] * 8).runs
    assert min(each.motion.time_s[0] for each in healthy) > 0.49
    assert 200.0 < sum(each.duration_s for each in healthy) < 300.0


RIVALS = {
    "load_offset": "external_force",
    "torque_gain_error": "inertia_error viscous_error drag_error",
    "lead_error": "encoder_eccentricity thermal_growth",
    "timestamp_skew": "viscous_error compliance",
    "delay": "inertia_error presliding compliance",
    "viscous_error": "quadratic_friction stribeck",
    "stribeck": "drag_error quadratic_friction load_friction presliding position_friction",
    "drag_error": "compliance",
    "backlash": "drag_error presliding compliance",
    "load_friction": "drag_error inertia_error torque_gain_error",
    "torque_ripple": "once_per_rev_friction",
    "external_force": "warmup thermal_growth",
}
"""Effects that some motion leaves tied: constant load and force, gain and a common scale of the
parameters, wobble and eccentricity, pitch and growth, skew and wind-up, the shapes of friction."""
TIES = [(name, rival) for name, rivals in RIVALS.items() for rival in rivals.split()]


@pytest.mark.parametrize("tied", TIES, ids="-".join)
def test_a_minute_at_most_decides_between_typical_faults(
    bench: Machine, tied: tuple[str, str]
) -> None:
    best, *others = propose(bench, tied)
    assert best.decides
    assert not any(each.decides for each in others)
    assert best.duration_s <= 60.0
    assert all(math.isfinite(pair.evidence) for pair in best.separations)
    assert {(pair.effect, pair.rival) for pair in best.separations} == {tied, tied[::-1]}


@pytest.mark.slow
def test_no_minute_decides_between_drag_and_slow_warming_up(bench: Machine) -> None:
    best = propose(bench, ("warmup", "drag_error"))[0]
    assert not best.decides
    assert 0.0 < best.evidence < DECISIVE


def _diagnosis(path: Path, **members: object) -> str:
    one = {"name": "load_offset", "probability": 0.5, "class": ["load_offset", "external_force"]}
    effects = [{**one, "entries": [{"constant_nm": 0.1}], **members}]
    path.write_text(json.dumps({"effects": effects}))
    return str(path)


def test_next_takes_a_diagnosis_and_writes_the_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "setpoints.csv"
    given = ["motion", "next", _diagnosis(tmp_path / "diagnosis.json"), "--out", str(out)]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert said.startswith("the shortest that decides: edge-service motion ")
    assert "expected evidence" in said
    times = [float(line.split(",")[0]) for line in out.read_text().splitlines()[-2:]]
    assert 5.0 < times[-1] <= 60.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no diagnosis.json"),
        ("[]", "no diagnosis.json"),
        ('{"effects": 3}', "no diagnosis.json"),
        ('{"effects": []}', "no effects that are tied"),
        ('{"effects": [{"name": "a", "probability": 0.5, "class": ["a", "b"]}]}', "'a'"),
    ],
)
def test_what_is_no_tie_is_one_line(tmp_path, capsys, text, says):
    path = tmp_path / "diagnosis.json"
    path.write_text(text)
    assert main(["motion", "next", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert says in said


@pytest.mark.parametrize(
    "given",
    [
        ["next"],
        ["next", "a.json", "--effect", "stribeck"],
        ["next", "--effect", "stribeck"],
        ["next", "missing.json"],
        ["isolability"],
        ["isolability", "dance"],
        ["isolability", "missing.csv"],
        ["friction", "a.csv", "--out", "b.csv"],
    ],
)
def test_bad_questions_are_one_line(capsys, given):
    assert main(["motion", *given]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_isolability_tells_what_shows_in_a_motion(capsys):
    assert main(["motion", "isolability", "standstill"]) == 0
    rows = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()[2:]}
    assert "nothing else" in rows["load_offset"]
    assert main(["motion", "isolability", "friction"]) == 0
    said = capsys.readouterr().out
    assert "quadratic_friction" in said
