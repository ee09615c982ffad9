"""The files that `edge-service motion` writes."""

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest

from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, MotionError, Setpoints, motion_limits
from edge_service.offline.motion import MotionFileSettings, list_motions, write_motion


def changed(machine: Machine, **axis: object) -> Machine:
    return machine.model_copy(update={"axis": machine.axis.model_copy(update=axis)})


def rows_of(path: Path) -> tuple[list[str], np.ndarray]:
    lines = path.read_text().splitlines()
    comments = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    assert lines[len(comments)] == (
        "time_s,position_setpoint_m,speed_setpoint_m_s,acceleration_setpoint_m_s2"
    )
    return comments, np.loadtxt(lines[len(comments) + 1 :], delimiter=",")


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_setpoints_are_those_of_the_motion_to_its_very_end(
    tmp_path: Path, machine: Machine, rate_hz: float
) -> None:
    out = tmp_path / "setpoints.csv"
    line = write_motion("friction", machine, out, MotionFileSettings(rate_hz=rate_hz)).words
    _, rows = rows_of(out)
    limits = motion_limits(machine)
    source = Setpoints(MOTIONS["friction"](limits, np.random.default_rng(0)), 0.04, rate_hz)
    wanted = source.take(len(rows))
    assert np.abs(rows[:, 1:] - wanted).max() < 1e-7
    assert rows[:, 0] == pytest.approx(np.arange(len(rows)) / rate_hz)
    assert rows[-1, 1:] == pytest.approx([0.04, 0.0, 0.0])
    assert source.take(10) == pytest.approx(np.tile([0.04, 0.0, 0.0], (10, 1)))
    assert f"{len(rows)} setpoints at {rate_hz:g} Hz" in line
    assert list(tmp_path.iterdir()) == [out]


def test_the_header_says_motion_machine_limits_and_what_is_assumed(
    tmp_path: Path, machine: Machine
) -> None:
    out = tmp_path / "setpoints.csv"
    write_motion("standstill", machine, out)
    header = "\n".join(rows_of(out)[0])
    duration_s = MOTIONS["standstill"].duration_s(motion_limits(machine))
    for part in (
        "motion standstill: rest after",
        f"axis X, lead 20 mm, duration {duration_s:.3f} s",
        "position 40 to 760 mm",
        "speed 119939 mm/min, acceleration 4 m/s2, torque 16 N m",
        "assumed, as the machine file lacks them: axis.max_speed_rad_s, "
        "axis.max_acceleration_m_s2, axis.max_torque_nm",
    ):
        assert part in header
    known = {"max_speed_rad_s": 314.0, "max_acceleration_m_s2": 2.0, "max_torque_nm": 10.0}
    write_motion("standstill", changed(machine, **known), out)
    header = "\n".join(rows_of(out)[0])
    assert "speed 59969.6 mm/min, acceleration 2 m/s2, torque 10 N m" in header
    assert "assumed" not in header


def test_what_is_left_out_is_named_in_file_and_in_answer(tmp_path: Path, machine: Machine) -> None:
    out = tmp_path / "setpoints.csv"
    slow = changed(machine, max_speed_rad_s=200.0)
    answer = write_motion("friction", slow, out, MotionFileSettings(clip=True)).words
    line = "left out: friction, 3000 r/min over 1 rev: speed: asks for 60000 mm/min, the axis"
    assert line in answer
    assert line in "\n".join(rows_of(out)[0])


def test_one_seed_is_one_file(tmp_path: Path, machine: Machine) -> None:
    texts = []
    for seed in (1, 1, 2):
        out = tmp_path / "setpoints.csv"
        write_motion("production", machine, out, MotionFileSettings(duration_s=20.0, seed=seed))
        texts.append(out.read_text())
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]


def test_a_duration_is_kept(tmp_path: Path, machine: Machine) -> None:
    out = tmp_path / "warm.csv"
    write_motion("warmup", machine, out, MotionFileSettings(duration_s=30.0, rate_hz=100.0))
    _, rows = rows_of(out)
    assert rows[-1, 0] == pytest.approx(30.0, abs=0.5)
    assert (rows[-1, 2:] == 0.0).all()


class Controller:
    """Reads an NC program block by block, as the words of the manual say."""

    def __init__(self, text: str) -> None:
        self.positions_m: list[float] = []
        self.feeds_m_s: list[float] = []
        self.accelerations_percent: list[float] = []
        self.dwells_s: list[float] = []
        percent = math.nan
        blocks = [line.split(";")[0].strip() for line in text.splitlines()]
        self.blocks = [block for block in blocks if block]
        for block in self.blocks:
            if move := re.fullmatch(r"G1 X=(-?[\d.]+) F([\d.e+]+)", block):
                self.positions_m.append(float(move[1]) / 1e3)
                self.feeds_m_s.append(float(move[2]) / 6e4)
                self.accelerations_percent.append(percent)
            elif dwell := re.fullmatch(r"G4 F([\d.]+)", block):
                self.dwells_s.append(float(dwell[1]))
            elif acc := re.fullmatch(r"ACC\[X\]=([\d.]+)", block):
                percent = float(acc[1])
            else:
                assert block in ("G90 G94 G710 G60 G601 SOFT", "M30")


@pytest.mark.parametrize(
    "name", ["standstill", "reversals", "friction", "signature", "acceleration"]
)
def test_an_nc_program_goes_where_setpoints_go(tmp_path: Path, machine: Machine, name: str) -> None:
    out = tmp_path / "program.mpf"
    write_motion(name, machine, out)
    controller = Controller(out.read_text())
    limits = motion_limits(machine)
    segments = list(MOTIONS[name](limits, np.random.default_rng(0)))
    moves = [each for each in segments if each.distance_m]
    ends = np.cumsum([0.04, *(each.distance_m for each in moves)])
    assert controller.positions_m == pytest.approx(list(ends), abs=1e-8)
    reached = [each.peak_speed_m_s for each in moves]
    assert (np.array(controller.feeds_m_s[1:]) >= np.array(reached) * (1.0 - 1e-5)).all()
    assert max(controller.feeds_m_s) <= limits.speed_m_s
    percent = 100.0 * np.array([each.peak_acceleration_m_s2 for each in moves]) / 4.0
    assert (np.array(controller.accelerations_percent[1:]) >= percent * (1.0 - 1e-3)).all()
    rests = [each.duration_s for each in segments if not each.distance_m]
    assert controller.dwells_s == pytest.approx(rests, rel=1e-3)
    assert controller.blocks[-1] == "M30"


def test_nc_program_says_constant_speeds_in_mm_per_minute(tmp_path: Path, machine: Machine) -> None:
    out = tmp_path / "program.mpf"
    write_motion("friction", machine, out)
    text = out.read_text()
    for mm_per_min in (300, 600, 1200, 2400, 3000, 6000, 12000, 24000, 30000, 60000):
        assert len(re.findall(rf" F{mm_per_min}$", text, re.MULTILINE)) >= 2


REFUSED = {
    "no motion 'fricton'; did you mean 'friction'?": ("fricton", "a.csv", {}),
    "expected a name that ends in .csv or .mpf": ("friction", "a.txt", {}),
    "chirp: vibrates, which an NC program cannot express": ("chirp", "a.mpf", {}),
    "multisine: vibrates": ("multisine", "a.mpf", {}),
    "full: vibrates": ("full", "a.mpf", {}),
    "production: does not end by itself": ("production", "a.csv", {}),
    "would cut it": ("friction", "a.csv", {"duration_s": 10.0}),
    "nan setpoints": ("friction", "a.csv", {"duration_s": math.nan}),
    "inf setpoints": ("warmup", "a.csv", {"duration_s": math.inf}),
    "a rate of 500 Hz for frequencies up to 300 Hz; expected at least 750 Hz": (
        "chirp",
        "a.csv",
        {"rate_hz": 500.0},
    ),
    "1e+12 setpoints; expected at most 20000000": ("warmup", "a.csv", {"duration_s": 1e9}),
    "1.31e+11 setpoints": ("friction", "a.csv", {"rate_hz": 1e9}),
}


@pytest.mark.parametrize("line", REFUSED)
def test_a_wrong_wish_is_one_line_and_leaves_the_old_file(
    tmp_path: Path, machine: Machine, line: str
) -> None:
    name, file, wishes = REFUSED[line]
    out = tmp_path / file
    out.write_text("old")
    with pytest.raises(MotionError) as error:
        write_motion(name, machine, out, MotionFileSettings(**wishes))  # type: ignore[arg-type]
    assert line in str(error.value)
    assert "\n" not in str(error.value)
    assert (out.read_text(), list(tmp_path.iterdir())) == ("old", [out])


def test_an_axis_of_unknown_stroke_or_strange_name_is_refused(
    tmp_path: Path, machine: Machine
) -> None:
    with pytest.raises(MotionError, match=r"axis\.stroke_m: the machine file lacks it"):
        write_motion("friction", changed(machine, stroke_m=None), tmp_path / "a.csv")
    with pytest.raises(MotionError, match=r"axis\.name: 'my axis' is not an axis of an NC program"):
        write_motion("friction", changed(machine, name="my axis"), tmp_path / "a.mpf")


def test_the_list_names_each_motion_with_its_duration_on_this_axis(machine: Machine) -> None:
    lines = list_motions(machine).words.splitlines()
    assert [line.split()[0] for line in lines] == list(MOTIONS)
    assert re.search(r"friction +131 s  ten speeds of Table 5\.1", lines[2])
    assert re.search(r"warmup +endless  rapids", "\n".join(lines))
    short = list_motions(changed(machine, stroke_m=0.2)).words
    assert re.search(r"signature +refused .* asks for 405\.1 mm, the axis allows 180 mm", short)
