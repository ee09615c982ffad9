"""The numbers of the mixture follow from the machine file."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.mixture.model import (
    CLEARANCE_M,
    MixtureSettings,
    axis_model,
    process_of,
    start_of,
)
from edge_service.estimate.mixture.state import (
    CHALLENGERS,
    CLOCK_SKEW,
    GUIDE_VISCOUS,
    HYPOTHESES,
    LOAD,
    LOOSENING,
    LOSS,
    LUBRICATION,
    NUT_COMPLIANCE,
    NUT_FRICTION,
    PRELOAD,
    STRETCH_STATES,
    TABLE_MASS,
    TORQUE_OFFSET,
    TORQUE_STATES,
    TORQUE_WANDER,
    TOTAL_LOSS,
)
from edge_service.models.machine import Machine

from .mixture_axis import (
    BEARING_NM,
    COMPLIANCE,
    COULOMB_NM,
    FRESH,
    FRESH_N,
    GUIDE_N,
    NUT_SHARE,
    PER_PERCENT_NM,
    RATIO,
    SETTINGS,
    machine,
    parts,
)


def test_the_model_divides_what_commissioning_found_into_screw_guides_and_bearings() -> None:
    model = parts()[0]
    assert model.ratio_m_per_rad == pytest.approx(RATIO)
    assert model.drag_per_percent_nm == pytest.approx(PER_PERCENT_NM)
    assert model.fresh_percent == pytest.approx(FRESH)
    assert model.fresh_preload_n == FRESH_N
    assert model.guide_n == pytest.approx(GUIDE_N)
    assert model.bearing_nm == pytest.approx(BEARING_NM)
    whole = FRESH * model.drag_per_percent_nm + model.bearing_nm + RATIO * model.guide_n
    assert whole == pytest.approx(COULOMB_NM)


def test_the_model_has_compliance_and_clearance_in_metres() -> None:
    model = parts()[0]
    assert model.compliance_m_per_n == pytest.approx(COMPLIANCE)
    assert model.compliance_slope_per_n == pytest.approx(1.5e-8)
    deflection_m = 3.0 * FRESH_N * NUT_SHARE * COMPLIANCE
    assert model.clearance_share * deflection_m == pytest.approx(0.5 * CLEARANCE_M)
    assert model.stretch_density == pytest.approx(3e-18)


def test_one_encoder_leaves_the_torques_states() -> None:
    model, start, process = parts(one_encoder=True)
    assert start.mean.shape == (TORQUE_STATES,)
    assert start.covariance.shape == start.load.shape == (TORQUE_STATES, TORQUE_STATES)
    assert process.walk.shape == (TORQUE_STATES,)
    assert model.compliance_m_per_n == model.guide_n == 0.0
    assert model.bearing_nm == pytest.approx(COULOMB_NM - FRESH * PER_PERCENT_NM)
    assert parts()[1].mean.shape == (STRETCH_STATES,)


def test_it_begins_at_the_commissioned_axis() -> None:
    start = parts()[1]
    assert math.exp(start.mean[PRELOAD]) == pytest.approx(FRESH)
    assert start.mean[TORQUE_OFFSET] == 0.01
    assert start.mean[CLOCK_SKEW] == 1e-6
    assert start.mean[NUT_COMPLIANCE] == pytest.approx(NUT_SHARE * COMPLIANCE)
    assert start.mean[TABLE_MASS] == SETTINGS.twist
    assert np.count_nonzero(start.mean) == 5
    deviation = math.sqrt(start.covariance[NUT_COMPLIANCE, NUT_COMPLIANCE])
    assert deviation == pytest.approx(0.1 * NUT_SHARE * COMPLIANCE)


def test_frictions_begin_a_stated_share_wider_than_after_a_long_time() -> None:
    covariance = parts()[1].covariance
    for i in range(NUT_FRICTION, GUIDE_VISCOUS + 1):
        share = SETTINGS.apart
        spread = SETTINGS.start_share**2
        assert covariance[i, i] == pytest.approx(spread * (SETTINGS.together**2 + share**2))
        for j in range(NUT_FRICTION, i):
            assert (
                covariance[i, j] == covariance[j, i] == pytest.approx(spread * SETTINGS.together**2)
            )


@pytest.mark.parametrize("larger", [0.5, 3.0])
def test_torques_and_forces_scale_with_the_friction_of_the_axis(larger: float) -> None:
    """The same axis with all of its friction larger."""
    plain = machine(one_encoder=True)
    taught, drag = plain.commissioned, plain.model.preload_drag_nm
    assert taught is not None
    assert drag is not None
    wider = plain.model_copy(
        update={
            "commissioned": taught.model_copy(update={"coulomb_nm": larger * taught.coulomb_nm}),
            "model": plain.model.model_copy(
                update={"preload_drag_nm": drag.model_copy(update={"value": larger * drag.value})}
            ),
        }
    )

    def sizes(of: Machine) -> list[float]:
        model = axis_model(of, SETTINGS)
        start = start_of(of, model, SETTINGS)
        process = process_of(of, model, start, SETTINGS)
        return [
            model.drag_per_percent_nm,
            model.bearing_nm,
            process.torque_wander_nm,
            process.axial_n,
            math.sqrt(start.covariance[TORQUE_OFFSET, TORQUE_OFFSET]),
            math.sqrt(start.covariance[TORQUE_WANDER, TORQUE_WANDER]),
            math.sqrt(process.walk[TORQUE_OFFSET]),
            math.sqrt(start.load[TORQUE_OFFSET, TORQUE_OFFSET]),
        ]

    np.testing.assert_allclose(sizes(wider), larger * np.array(sizes(plain)), rtol=1e-12)


def test_what_may_happen_is_what_the_encoders_can_tell() -> None:
    both, one = parts()[2], parts(one_encoder=True)[2]
    seen = (LOSS, TOTAL_LOSS, LUBRICATION)
    per_motion, per_stop = math.log(SETTINGS.hazard), math.log(SETTINGS.stop_hazard)
    assert {k for k in range(HYPOTHESES) if both.priors[k] == per_motion} == set(CHALLENGERS)
    assert {k for k in range(HYPOTHESES) if one.priors[k] == per_motion} == set(seen)
    assert {k for k in range(HYPOTHESES) if both.stop_priors[k] == per_stop} == {LUBRICATION, LOAD}
    assert {k for k in range(HYPOTHESES) if one.stop_priors[k] == per_stop} == {LUBRICATION}
    assert max(both.priors) == per_motion
    assert max(both.stop_priors) == per_stop


@pytest.mark.parametrize("slot", CHALLENGERS)
def test_an_axis_can_be_without_a_step(slot: int) -> None:
    settings = replace(SETTINGS, without=(slot,))
    model = axis_model(machine(), settings)
    process = process_of(machine(), model, start_of(machine(), model, settings), settings)
    assert process.priors[slot] == process.stop_priors[slot] == -math.inf
    assert np.isfinite(process.priors).sum() == len(CHALLENGERS) - 1


def test_an_axis_whose_friction_never_moves_begins_with_none() -> None:
    settings = MixtureSettings(together=0.0, apart=0.0)
    model = axis_model(machine(), settings)
    start = start_of(machine(), model, settings)
    process = process_of(machine(), model, start, settings)
    rows = slice(NUT_FRICTION, GUIDE_VISCOUS + 1)
    assert not start.covariance[rows].any()
    assert not process.walk[rows].any()
    assert process.together == 0.0


def test_steps_add_to_what_they_are_named_for() -> None:
    jumps = parts()[2].jumps
    assert np.flatnonzero(jumps[LOSS]).tolist() == [0]
    assert set(np.flatnonzero(jumps[LUBRICATION].any(axis=0))) == set(
        range(NUT_FRICTION, GUIDE_VISCOUS + 1)
    )
    for k in (LOSS, LUBRICATION, LOAD, LOOSENING):
        assert np.linalg.eigvalsh(jumps[k]).min() > -1e-18
