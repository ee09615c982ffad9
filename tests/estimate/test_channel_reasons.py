"""A fault of a channel is named beside the number and without one."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.checks.live.channel_check import channel_reasons
from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.estimate.imm.estimator import ImmPreloadEstimator
from edge_service.estimate.validity import Validity
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from edge_service.models.machine import Machine

MACHINE = Machine.model_validate(
    {
        "axis": {"lead_m": 0.02, "dynamic_load_rating_n": 7450.0},
        "model": {
            "inertia_kg_m2": 1.5e-3,
            "viscous_nm_s_per_rad": 5e-3,
            "preload_drag_nm": 0.146,
            "preload_n": 510.0,
        },
    }
)


@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        (Fault.NONE, []),
        (Fault.HOLE, []),
        (Fault.NO_TABLE, ["table_missing"]),
        (Fault.NO_TABLE | Fault.TABLE_STUCK, ["table_stuck"]),
        (Fault.NO_TABLE | Fault.TABLE_DISAGREES, ["table_disagrees"]),
        (Fault.NO_TABLE | Fault.TABLE_DOUBTED, ["table_doubted"]),
        (
            Fault.NO_TABLE | Fault.TABLE_DOUBTED | Fault.TABLE_SHIFTED,
            ["table_doubted", "table_shifted"],
        ),
        (Fault.TABLE_SHIFTED, ["table_shifted"]),
        (Fault.STUCK | Fault.TORQUE_STUCK, ["torque_stuck"]),
        (Fault.STUCK | Fault.ANGLE_STUCK, ["angle_stuck"]),
        (Fault.NO_TORQUE | Fault.NO_POSITION, ["torque_missing", "angle_missing"]),
        (Fault.TORQUE_OUTLIERS | Fault.TABLE_OUTLIERS, ["torque_outliers", "table_outliers"]),
        (Fault.ANGLE_OUTLIERS | Fault.TORQUE_HELD, ["angle_outliers", "torque_held"]),
        (Fault.NO_TABLE | Fault.TABLE_HELD | Fault.ANGLE_HELD, ["angle_held", "table_held"]),
    ],
)
def test_each_fault_of_a_channel_has_its_code(fault: Fault, codes: list[str]) -> None:
    assert [reason.partition(": ")[0] for reason in channel_reasons(fault)] == codes


def blocks() -> list[FeatureBlock]:
    """Six seconds at 20 rad/s; the linear encoder stands still from the third second on."""
    rng = np.random.default_rng(5)
    time_s = np.arange(6000) / 1e3
    angle = 20.0 * time_s
    table = MACHINE.transmission_ratio_m_per_rad * np.minimum(angle, 60.0)
    torque = 0.146 + 0.1 + 0.01 * rng.standard_normal(len(time_s))
    downsampler = Downsampler(DownsampleSettings(), MACHINE.transmission_ratio_m_per_rad)
    channels = {TORQUE: torque, ANGLE: angle, TABLE_POSITION: table}
    return downsampler.push(SampleFrame(time_s, channels))


def test_a_number_goes_on_and_says_which_channel_it_lacks() -> None:
    estimator = ImmPreloadEstimator(MACHINE)
    answers = []
    for block in blocks():
        estimator.update(block)
        answers.append(estimator.estimate())
    before = [each for each in answers if 2.0 < each.time_s < 2.95]
    after = [each for each in answers if each.time_s > 3.15]
    assert {each.status for each in (*before, *after)} == {EstimateStatus.ESTIMATED}
    assert {each.reasons for each in before} == {()}
    assert {each.reasons[0].partition(":")[0] for each in after} == {"table_stuck"}
    assert "torque alone" in after[0].reasons[0]
    assert all(each.preload_percent is not None for each in after)


def test_the_reason_is_kept_over_a_restart_and_goes_with_the_fault() -> None:
    validity = Validity()
    sound = replace(blocks()[15], time_s=1.6, external_force_n=math.nan)
    validity.update(replace(sound, fault=Fault.NO_TABLE | Fault.TABLE_STUCK), True, 1.0)
    again = Validity()
    again.restore(validity.snapshot())
    assert again.status() == validity.status()
    assert again.status()[1][-1].startswith("table_stuck: ")
    again.update(replace(sound, time_s=1.7), True, 1.0)
    assert not any("table" in reason for reason in again.status()[1])


def test_a_torque_that_stands_says_so_beside_the_data_fault() -> None:
    validity = Validity()
    stuck = replace(blocks()[15], fault=Fault.STUCK | Fault.TORQUE_STUCK)
    for step in range(25):
        validity.update(replace(stuck, time_s=1.6 + 0.1 * step), False, None)
    status, reasons = validity.status()
    assert status is EstimateStatus.INVALID
    assert [reason.partition(":")[0] for reason in reasons] == ["data_fault", "torque_stuck"]
