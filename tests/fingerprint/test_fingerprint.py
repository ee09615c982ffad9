"""A fingerprint holds the truth of the simulated axis, and tells a changed one from it."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from edge_service.fingerprint.compare import appeared_figures, compare_fingerprints
from edge_service.fingerprint.fingerprint import fingerprint_axis
from edge_service.fingerprint.friction.cruises import measure_signature
from edge_service.fingerprint.result import (
    AxisFingerprint,
    FingerprintError,
    Status,
    read_fingerprint,
)
from edge_service.messages import samples
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import MOTIONS, Dwell, Move, Segment, motion_limits
from edge_service.models.plant.two_mass import axial_compliance
from edge_service.models.screw.ball_screw import ball_pass_orders
from edge_service.regression.prepared_run import PreparationSettings, PreparedRun

from .conftest import FRESH, run_axis, setpoints_of

GUIDE_N, BEARING_NM, DRAG_NM, VISCOUS, INERTIA = 150.0, 0.05, 0.146, 5e-3, 1.5e-3
WORN_PERCENT, PLAY_M = 4.0, 8e-6
RATIO = 0.02 / (2.0 * math.pi)
EXCESS_NM, STRIBECK_RAD_S = 0.15, 8.0


@pytest.fixture(scope="module")
def machine(bench: Machine) -> Machine:
    model = bench.model.model_copy(
        update={
            "guide_force_n": Quantity(value=GUIDE_N),
            "bearing_drag_nm": Quantity(value=BEARING_NM),
            "table_mass_kg": Quantity(value=20.0),
            "nut_stiffness_n_per_m": Quantity(value=0.8 * 1.6e8 * (FRESH / 10.0) ** (1.0 / 3.0)),
        }
    )
    return bench.model_validate(bench.model_dump() | {"model": model.model_dump()})


def friction_moves() -> list[Segment]:
    """Cruises at seven speeds both ways: a friction test of half a minute."""
    moves: list[Segment] = [Dwell(0.3)]
    for rpm in (30.0, 60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0):
        speed = rpm / 60.0 * 0.02
        length = min(max(1.6 * speed, 0.02), 0.7)
        for way in (1.0, -1.0):
            moves += [Move(way * length, speed, 4.0, 400.0), Dwell(0.2)]
    return moves


def session(
    settings: FeedDriveSettings, machine: Machine, seed: int, percent: float = FRESH
) -> dict[str, SampleFrame]:
    limits = motion_limits(machine)
    plans = {
        "friction": friction_moves(),
        **{
            name: list(MOTIONS[name].plan(limits, np.random.default_rng(seed)).segments)
            for name in ("acceleration", "reversals")
        },
    }
    return {
        name: run_axis(settings, setpoints_of(segments, limits.low_m), seed + k, percent)
        for k, (name, segments) in enumerate(plans.items())
    }


@pytest.fixture(scope="module")
def fresh_settings(machine: Machine) -> FeedDriveSettings:
    return FeedDriveSettings.of_machine(machine)


@pytest.fixture(scope="module")
def recordings(machine: Machine, fresh_settings: FeedDriveSettings) -> dict[str, SampleFrame]:
    return session(fresh_settings, machine, 1)


@pytest.fixture(scope="module")
def healthy(machine: Machine, recordings: dict[str, SampleFrame]) -> AxisFingerprint:
    return fingerprint_axis(machine, recordings)


@pytest.fixture(scope="module")
def worn(machine: Machine, healthy: AxisFingerprint) -> AxisFingerprint:
    effects = [
        parse_effect(f"stribeck:excess_nm={EXCESS_NM},speed_rad_s={STRIBECK_RAD_S}"),
        parse_effect(f"backlash:width_m={PLAY_M}"),
    ]
    settings = FeedDriveSettings.of_machine(machine, effects=effects)
    return fingerprint_axis(machine, session(settings, machine, 11, WORN_PERCENT), healthy)


def test_figures_hold_truth(healthy: AxisFingerprint, fresh_settings: FeedDriveSettings) -> None:
    figures = healthy.figures()
    coulomb = DRAG_NM + BEARING_NM + GUIDE_N * RATIO
    assert figures["friction.coulomb_nm"].value == pytest.approx(coulomb, rel=0.005)
    assert figures["friction.viscous_nm_s_per_rad"].value == pytest.approx(VISCOUS, rel=0.01)
    assert figures["inertia.inertia_kg_m2"].holds(INERTIA)
    assert figures["preload.preload_from_drag_n"].holds(510.0)
    for mm in (160, 400, 640):
        truth = 1.0 / axial_compliance(fresh_settings.plant, mm / 1000.0, FRESH)
        assert figures[f"stiffness.stiffness_at_{mm}_mm_n_per_m"].holds(truth)
        assert figures[f"backlash.backlash_at_{mm}_mm_m"].holds(0.0)
    levels = {name: f for name, f in figures.items() if ".level_" in name}
    assert len(levels) >= 7
    for name, level in levels.items():
        speed = float(name.split("_")[1]) * 2.0 * math.pi / 60.0
        assert level.value == pytest.approx(coulomb + VISCOUS * speed, rel=0.01), name


def test_the_encoders_part_by_the_wind_up_at_a_reversal(
    healthy: AxisFingerprint, fresh_settings: FeedDriveSettings
) -> None:
    step = healthy.figures()["reversal_error.encoder_step_m"]
    windup = 2.0 * GUIDE_N * axial_compliance(fresh_settings.plant, 0.4, FRESH)
    assert step.value == pytest.approx(windup, rel=0.05)


def test_a_worn_axis_is_called_changed(healthy: AxisFingerprint, worn: AxisFingerprint) -> None:
    figures = worn.figures()
    assert figures["backlash.backlash_at_400_mm_m"].holds(PLAY_M)
    assert figures["preload.preload_from_stiffness_n"].holds(WORN_PERCENT / 100.0 * 7450.0)
    assert figures["friction.stribeck_excess_nm"].value == pytest.approx(EXCESS_NM, rel=0.25)
    changed = {change.name for change in compare_fingerprints(worn, healthy) if change.changed}
    assert {
        "backlash.backlash_at_400_mm_m",
        "stiffness.stiffness_at_400_mm_n_per_m",
        "friction.coulomb_nm",
        "preload.preload_from_drag_n",
    } <= changed
    assert "inertia.inertia_kg_m2" not in changed
    assert "friction.stribeck_excess_nm" in appeared_figures(worn, healthy)


@pytest.mark.slow
def test_the_same_axis_on_another_day_has_not_changed(
    machine: Machine, fresh_settings: FeedDriveSettings, healthy: AxisFingerprint
) -> None:
    again = fingerprint_axis(machine, session(fresh_settings, machine, 21), healthy)
    changes = compare_fingerprints(again, healthy)
    assert len(changes) > 20
    assert [change.name for change in changes if change.changed] == []
    assert not [name for name in appeared_figures(again, healthy) if "stribeck" in name]
    assert again.figures()["preload.preload_from_stiffness_n"].holds(510.0)


@pytest.mark.slow
def test_one_encoder_leaves_the_transmission_undetermined(
    machine: Machine, recordings: dict[str, SampleFrame]
) -> None:
    kept = (samples.TORQUE, samples.ANGLE, samples.SETPOINT)
    blind = {
        name: SampleFrame(frame.time_s, {key: frame.channels[key] for key in kept})
        for name, frame in recordings.items()
    }
    sections = fingerprint_axis(machine, blind).sections
    for name, motion in (("stiffness", "acceleration"), ("backlash", "reversals")):
        assert sections[name].status is Status.UNDETERMINED
        assert samples.TABLE_POSITION in sections[name].reason
        assert sections[name].motion == motion
    assert sections["frequency_response"].status is Status.UNDETERMINED
    assert sections["friction"].status is Status.DETERMINED
    assert sections["inertia"].figures["inertia_kg_m2"].holds(INERTIA)


def test_a_document_comes_back_as_it_was(worn: AxisFingerprint, tmp_path: Path) -> None:
    path = tmp_path / "fingerprint.json"
    document = TypeAdapter(AxisFingerprint).dump_python(worn, mode="json")
    path.write_text(json.dumps(document, allow_nan=False))
    back = read_fingerprint(path)
    assert TypeAdapter(AxisFingerprint).dump_python(back, mode="json") == document
    assert [c.name for c in compare_fingerprints(back, worn) if c.significant] == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", "not JSON"),
        ("[]", "schema None"),
        ('{"schema": "gap/1"}', "schema 'gap/1'"),
        ('{"schema": "fingerprint/1", "machine": "X", "sources": []}', "not a complete"),
    ],
)
def test_a_baseline_that_is_none_is_named_in_one_line(
    tmp_path: Path, text: str, expected: str
) -> None:
    path = tmp_path / "old.json"
    path.write_text(text)
    with pytest.raises(FingerprintError, match=expected) as caught:
        read_fingerprint(path)
    assert "\n" not in str(caught.value)


def cruise(revolutions_per_s: float, torque_nm: Floats, count: int = 20_000) -> PreparedRun:
    """One run at constant speed, 1 kHz, 100 Hz of low-pass."""
    speed = 2.0 * np.pi * revolutions_per_s
    return PreparedRun(
        settings=PreparationSettings(ratio_m_per_rad=1e-3, cutoff_hz=100.0),
        period_s=1e-3,
        start_s=0.0,
        noise_rms={},
        channels={samples.ANGLE: speed * np.arange(count) / 1e3, samples.TORQUE: torque_nm},
        speed_rad_s=np.full(count, speed),
        acceleration_rad_s2=np.zeros(count),
        moving=np.ones(count, dtype=bool),
    )


def test_balls_that_pass_are_named_by_their_orders() -> None:
    """A ripple of 12 mN m at the screw's ball-pass order; none at the nut's."""
    balls = ball_pass_orders(3.175e-3, 0.0206, 0.02, math.radians(45.0))
    angle = 2.0 * np.pi * 2.0 * np.arange(60_000) / 1e3
    noise = 1e-4 * np.random.default_rng(2).standard_normal(60_000)
    run = cruise(2.0, 0.3 + 0.012 * np.sin(balls.on_screw * angle) + noise, 60_000)
    figures, _ = measure_signature([run], balls)
    on_screw = figures["ball_pass_on_screw_120_rpm_nm"]
    assert on_screw.value == pytest.approx(0.012 / math.sqrt(2.0), rel=0.05)
    assert on_screw.note == f"ball pass on screw {balls.on_screw:.1f}/rev"
    assert figures["ball_pass_on_nut_120_rpm_nm"].value < 1e-3
    fast, _ = measure_signature([cruise(8.0, np.full(20_000, 0.3))], balls)
    assert "above the low-pass" in fast["ball_pass_on_screw_480_rpm_nm"].note
    unknown, _ = measure_signature([run])
    assert not unknown["ball_pass_nm"].determined
    assert "axis.ball_diameter_m" in unknown["ball_pass_nm"].note
