"""Commissioning refuses what recordings cannot determine; maps hold where the axis has been."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import ConfigError, load_machine
from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.commissioning.phases import (
    CommissioningError,
    SteadyPhases,
    observed_limits,
)
from edge_service.estimate.commissioning.series_compliance import (
    SeriesCompliance,
    fit_series_compliance,
)
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine
from edge_service.nodes.stages import make_downsampler
from edge_service.offline.commission import commission_to_file

from ..mixture.mixture_axis import RATIO, STROKE_M, machine
from .plain_axis import PlainAxis

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data"
ACTUATORS = DATA / "screw_actuators"
EMPS = DATA / "emps" / "emps_estimation.csv"
CRANFIELD = DATA / "cranfield" / "lackLubrication1.csv"
BENCH = PlainAxis()
SMALL = PlainAxis(
    lead_m=0.005,
    table_kg=15.0,
    rotor_kg_m2=2e-4,
    viscous_nm_s=1e-3,
    screw_nm=0.05,
    bearing_nm=0.02,
    guide_n=40.0,
    stroke_m=0.3,
    top_rad_s=300.0,
    acceleration_rad_s2=2000.0,
    rate_hz=2000.0,
)
HEAVY = PlainAxis(
    lead_m=0.01,
    table_kg=400.0,
    rotor_kg_m2=3e-3,
    screw_nm=0.4,
    bearing_nm=0.1,
    guide_n=200.0,
    hanging_nm=1.0,
    stiffness_n_per_m=1e8,
    nut_n_per_m=4e8,
    stroke_m=1.2,
    top_rad_s=100.0,
    acceleration_rad_s2=200.0,
    rate_hz=500.0,
    quantum_nm=0.01,
)
SLOW = replace(HEAVY, lead_m=0.02, hanging_nm=0.0, top_rad_s=8.0, acceleration_rad_s2=20.0)
NOISE_M = 3e-8
LOW_M, HIGH_M = 0.3 * STROKE_M, 0.7 * STROKE_M
PER_ACCELERATION_S2 = 1e-6


def cut(axis: PlainAxis, frame: SampleFrame | None = None) -> list[FeatureBlock]:
    """Blocks of a recording, with the limits that its motion asks for."""
    frame, machine = frame or axis.frame(), axis.machine()
    blocks = make_downsampler(machine).push(frame)
    return make_downsampler(machine, observed_limits([blocks])).push(frame)


def learned(axis: PlainAxis, **stated: float) -> Machine:
    blocks = cut(axis)
    return commissioned([blocks], axis.machine(**stated), observed_limits([blocks]))


@pytest.mark.parametrize(
    "axis",
    [BENCH, SMALL, HEAVY, SLOW, replace(BENCH, hanging_nm=6.0)],
    ids=["bench", "lead 5 at 2 kHz", "400 kg upright at 500 Hz", "slow", "hangs"],
)
def test_axes_of_any_size_are_recovered(axis: PlainAxis) -> None:
    machine = learned(axis)
    taught, model = machine.commissioned, machine.model
    assert taught is not None and taught.transmission is not None
    assert model.inertia_kg_m2.value == pytest.approx(axis.inertia_kg_m2, rel=0.003)
    assert taught.coulomb_nm == pytest.approx(axis.coulomb_nm, rel=0.003)
    assert taught.torque_offset_nm == pytest.approx(axis.hanging_nm, abs=0.003 * axis.coulomb_nm)
    assert model.guide_force_n.value == pytest.approx(axis.guide_n, rel=0.02)
    stiffness = axis.table_kg / taught.transmission.stretch_per_acceleration_s2
    assert stiffness == pytest.approx(axis.stiffness_n_per_m, rel=0.02)


def test_with_one_encoder_no_friction_is_told_of_the_bearings() -> None:
    for axis, screw_nm in ((BENCH, 0.146), (HEAVY, 0.1)):
        model = learned(replace(axis, one_encoder=True, screw_nm=screw_nm)).model
        assert model.bearing_drag_nm.value == 0.0


def test_a_counterweight_that_grows_along_the_stroke_is_no_process_force() -> None:
    axis = replace(BENCH, hanging_nm=2.0, chain_nm=-0.3)
    taught = learned(axis).commissioned
    assert taught is not None
    assert taught.coulomb_nm == pytest.approx(axis.coulomb_nm, rel=0.01)


def test_seals_and_bearings_of_a_light_table_may_hold_back_more_than_it_weighs() -> None:
    light = replace(SMALL, lead_m=0.01, table_kg=5.0, screw_nm=0.1, bearing_nm=0.1, guide_n=120.0)
    assert learned(light).model.guide_force_n.value == pytest.approx(light.guide_n, rel=0.02)
    thin = replace(light, table_kg=2.0, screw_nm=0.02, one_encoder=True)
    nominal = thin.machine()
    model = nominal.model.model_copy(update={"table_mass_kg": None})
    taught = commissioned([cut(thin)], nominal.model_copy(update={"model": model})).commissioned
    assert taught is not None and taught.coulomb_nm > 10.0 * thin.screw_nm


def test_an_encoder_that_shrinks_the_inertia_widens_its_tolerance() -> None:
    axis = replace(BENCH, encoder_rad=2e-4, one_encoder=True)
    inertia = learned(axis).model.inertia_kg_m2
    assert 0.02 * axis.inertia_kg_m2 < axis.inertia_kg_m2 - inertia.value < 2.0 * inertia.sigma


def test_limits_come_down_with_the_motion_and_are_kept() -> None:
    slow, fast = learned(SLOW).commissioned, learned(BENCH).commissioned
    assert slow is not None and fast is not None
    assert slow.slowest_rad_s == pytest.approx(SLOW.top_rad_s / 75.0, rel=0.01)
    assert slow.cruise_rad_s2 == pytest.approx(0.1 * SLOW.acceleration_rad_s2, rel=0.05)
    assert (fast.slowest_rad_s, fast.cruise_rad_s2) == (None, None)


REFUSED: dict[str, tuple[PlainAxis, dict[str, float], str]] = {
    "coarse encoder": (replace(BENCH, encoder_rad=2e-2, one_encoder=True), {}, "with the window"),
    "late torque": (replace(BENCH, late_s=0.01), {}, "ms later than the acceleration"),
    "another inertia": (BENCH, {"inertia_kg_m2": 1.5e-2}, "model.inertia_kg_m2"),
    "a tenth of the inertia": (BENCH, {"inertia_kg_m2": 1.5e-4}, "model.inertia_kg_m2"),
    "worn screw": (replace(BENCH, screw_nm=0.03), {"preload_drag_nm": 0.146}, "worn or warm"),
    "unexplained friction": (replace(BENCH, bearing_nm=2.0), {}, "more than the table weighs"),
    "stiffer than its nut": (BENCH, {"nut_stiffness_n_per_m": 1e7}, "nut_stiffness_n_per_m"),
    "another mass": (BENCH, {"table_mass_kg": 0.5}, "table_mass_kg"),
    "five times the mass": (BENCH, {"table_mass_kg": 400.0}, r"guides and -.*_nm\): needs the"),
}


@pytest.mark.parametrize(("axis", "stated", "reason"), REFUSED.values(), ids=REFUSED)
def test_what_contradicts_is_refused_in_one_line(
    axis: PlainAxis, stated: dict[str, float], reason: str
) -> None:
    with pytest.raises(CommissioningError, match=reason) as caught:
        learned(axis, **stated)
    assert "\n" not in str(caught.value)


def test_torque_that_motion_does_not_explain_is_refused() -> None:
    frame = BENCH.frame()
    pushes = np.repeat(np.random.default_rng(2).standard_normal(len(frame) // 150 + 1), 150)
    pushed_nm = frame.channels[TORQUE] + 3.0 * pushes[: len(frame)]
    pushed = SampleFrame(frame.time_s, {**frame.channels, TORQUE: pushed_nm})
    with pytest.raises(CommissioningError, match="motion explains too little"):
        commissioned([cut(BENCH, pushed)], BENCH.machine())


LIN_A = """
[axis]
name = "LinA"
lead_m = {lead_m!r}

[model]
inertia_kg_m2 = {{ value = 1.63e-6, tolerance = 0.1 }}

[columns]
time_s = {{ column = "time_ms", scale = 1e-3 }}
torque_command_nm = {{ column = "current_ma", scale = 42.9e-6 }}
table_position_m = {{ column = "position_mm", scale = 1e-3 }}
"""
LIN_A_LEAD_M = 0.006 * 35.0 / 624.0
"""The recorded speed is the screw's in rad/s: its ratio to mm/s is 6 mm a turn."""


@pytest.mark.skipif(not ACTUATORS.exists(), reason="the recordings of the actuators are not here")
@pytest.mark.parametrize(
    "name", ["no-pp-sine-sweep-10mm-0.5Hz", "pp-sine-sweep-10mm-0.5Hz", "pp-square-wave-10mm-0.5Hz"]
)
def test_samples_too_slow_for_the_inertia_are_refused(name: str, tmp_path: Path) -> None:
    """A tenth of the inertia came out of these, with an interval of 14 %."""
    table = np.loadtxt(ACTUATORS / f"LinA_{name}.txt")
    trace, machine_file = tmp_path / "trace.csv", tmp_path / "machine.toml"
    header = "time_ms,target_mm,demand_mm,position_mm,speed,current_ma"
    np.savetxt(trace, table, delimiter=",", header=header, comments="")
    machine_file.write_text(LIN_A.format(lead_m=LIN_A_LEAD_M))
    with pytest.raises(ConfigError, match=r"faster samples|sampled with the position"):
        commission_to_file(machine_file, [trace], tmp_path / "out.toml")
    assert not (tmp_path / "out.toml").exists()


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS recordings are not here")
def test_emps_is_commissioned_to_the_published_mass(tmp_path: Path) -> None:
    """95.1 kg, published; friction 20.4 N."""
    out = tmp_path / "out.toml"
    commission_to_file(ROOT / "deploy/emps.toml", [EMPS], out)
    machine = load_machine(out)
    ratio = machine.transmission_ratio_m_per_rad
    assert machine.model.inertia_kg_m2.value / ratio**2 == pytest.approx(95.1089, rel=0.01)
    assert machine.commissioned is not None
    assert machine.commissioned.coulomb_nm / ratio == pytest.approx(20.3935, rel=0.05)


@pytest.mark.skipif(not CRANFIELD.exists(), reason="the recordings of Cranfield are not here")
def test_an_unsigned_current_is_refused(tmp_path: Path) -> None:
    raw = np.genfromtxt(CRANFIELD, delimiter=",", names=True, dtype=None, encoding="utf-8")
    chosen = raw[(raw["load"] == 20) & (raw["run"] == 1)]
    time_s = 0.04 * np.arange(len(chosen))
    position_mm = chosen["set_point"] - chosen["position_error"]
    trace, machine_file = tmp_path / "trace.csv", tmp_path / "machine.toml"
    columns = np.column_stack([time_s, position_mm, chosen["current"]])
    np.savetxt(trace, columns, delimiter=",", header="t_s,x_mm,current_a", comments="")
    machine_file.write_text(
        f"[axis]\nlead_m = 0.005\n[model]\ninertia_kg_m2 = {1e-4}\n[columns]\n"
        'time_s = "t_s"\ntorque_command_nm = { column = "current_a", scale = 0.1 }\n'
        'table_position_m = { column = "x_mm", scale = 1e-3 }\n'
    )
    with pytest.raises(ConfigError, match="a magnitude"):
        commission_to_file(machine_file, [trace], tmp_path / "out.toml")


def uneven(place_m: Floats, size_m: float) -> Floats:
    """An error of the lead, two waves to the stroke."""
    return np.asarray(size_m * np.sin(4.0 * np.pi * place_m / STROKE_M))


def taught(size_m: float, seed: int = 3) -> tuple[SeriesCompliance, Floats]:
    """Fit learned between LOW_M and HIGH_M, and the places of the maps' nodes, (k,)."""
    rng = np.random.default_rng(seed)
    count = 3000
    table_m = rng.uniform(LOW_M, HIGH_M, count)
    direction = rng.choice([-1.0, 1.0], count)
    speed_m_s = direction * rng.uniform(0.05, 0.5, count)
    acceleration_m_s2 = rng.choice([-5.0, 0.0, 5.0], count)
    stretch_m = PER_ACCELERATION_S2 * acceleration_m_s2 + 1e-6 * direction
    stretch_m += uneven(table_m, size_m) + NOISE_M * rng.standard_normal(count)
    phases = SteadyPhases(
        run=np.zeros(count),
        time_s=0.1 * np.arange(count),
        steady_s=np.full(count, 0.1),
        direction=direction,
        torque_nm=np.zeros(count),
        acceleration_rad_s2=acceleration_m_s2 / RATIO,
        speed_rad_s=speed_m_s / RATIO,
        angle_rad=(table_m + stretch_m) / RATIO,
        table_m=table_m,
    )
    found = fit_series_compliance(phases, machine(), lambda places, _: np.zeros_like(places))
    assert found is not None
    return found, np.linspace(0.0, STROKE_M, len(found.lead_map_m))


def test_the_map_is_right_where_the_axis_has_been() -> None:
    """But for a straight line, which the zeros of the encoders and the screw's growth hold."""
    found, nodes = taught(2e-6)
    assert found.per_acceleration_s2 == pytest.approx(PER_ACCELERATION_S2, rel=0.01)
    inside = (nodes > LOW_M + 0.02 * STROKE_M) & (nodes < HIGH_M - 0.02 * STROKE_M)
    off = found.lead_map_m - uneven(nodes, 2e-6)
    line = np.polynomial.Polynomial.fit(nodes[inside], off[inside], 1)
    assert np.abs(off[inside] - line(nodes[inside])).max() < 3e-8
    assert found.map_sigma_m[inside].max() < 5e-8


def test_beyond_it_is_as_at_the_last_place_and_ever_less_sure() -> None:
    found, nodes = taught(2e-6)
    below, above = nodes < LOW_M - 0.03 * STROKE_M, nodes > HIGH_M + 0.03 * STROKE_M
    for beyond in (below, above):
        assert np.ptp(found.lead_map_m[beyond]) < 1e-9
    assert (np.diff(found.map_sigma_m[below]) < 0.0).all()
    assert (np.diff(found.map_sigma_m[above]) > 0.0).all()
    assert found.map_sigma_m[[0, -1]].min() > 5e-7


def test_how_unsure_follows_from_how_uneven_the_screw_is() -> None:
    even, uneven_one = taught(0.0)[0], taught(2e-6)[0]
    assert even.map_sigma_m[[0, -1]].max() < 0.1 * uneven_one.map_sigma_m[[0, -1]].min()
