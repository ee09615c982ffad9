"""Why a linear model would not fit the bench: what the story rests on."""

from functools import cache, partial

import numpy as np
import pytest

from edge_service.diagnose.session.session import TRANSMISSION_GAP
from edge_service.messages.samples import SampleFrame
from edge_service.models.effects.registry import get_effect
from edge_service.models.effects.signature import transmission_signature
from edge_service.models.machine import Machine
from edge_service.offline.reproduce import puzzle


@cache
def situation() -> tuple[list[SampleFrame], Machine]:
    bench = puzzle.bench_machine()
    frames = puzzle.recorded(bench)
    return frames, puzzle.linear_model(bench, frames)


@pytest.mark.slow
def test_no_inertia_and_viscous_friction_near_the_fitted_ones_fit_better() -> None:
    frames, linear = situation()
    fitted = puzzle.fitted(linear, frames)
    best = puzzle.gap_of(fitted, frames)["torque_nm"]
    assert best < puzzle.gap_of(linear, frames)["torque_nm"]
    for key in ("inertia_kg_m2", "viscous_nm_s_per_rad"):
        for factor in (0.97, 1.03):
            quantity = getattr(fitted.model, key)
            near = quantity.model_copy(update={"value": factor * quantity.value})
            model = fitted.model.model_copy(update={key: near})
            other = fitted.model_copy(update={"model": model})
            assert puzzle.gap_of(other, frames)["torque_nm"] > best


def test_what_is_left_between_the_encoders_is_the_falling_stiffness() -> None:
    frames, linear = situation()
    session = puzzle.session_of(linear, frames)
    effect = get_effect("compliance")
    curves = [
        partial(transmission_signature, effect, effect.complete({name: 1e-8}))
        for name in ("level_m_per_n", "slope_per_n")
    ]
    columns = np.column_stack(
        [
            session.column(TRANSMISSION_GAP, partial(curve, baseline=session.baseline))
            for curve in curves
        ]
    )
    rows = session.channels[TRANSMISSION_GAP]
    beta = np.linalg.lstsq(columns, rows.gap, rcond=None)[0]
    left = float(np.sqrt(np.mean((rows.gap - columns @ beta) ** 2)))
    assert beta[1] > 0.0  # it gives more, further from the fixed bearing
    assert left < 0.5 * rows.rms


def test_the_picture_has_a_bar_for_each_step() -> None:
    before = {"torque_nm": 0.2, "transmission_m": 1e-6}
    step = puzzle.Step("drag_error", {"torque_nm": 0.1, "transmission_m": 1e-6})
    found = puzzle.Puzzle(before, before, before, ("explained",), (step,))
    figure = puzzle.draw_puzzle(found)
    labels = [each.get_text() for each in figure.axes[0].get_yticklabels()]
    assert labels == ["linear model", "(fitted)", "+ drag error"]


@pytest.mark.slow
def test_the_diagnosis_says_that_it_is_dry_friction() -> None:
    found = puzzle.solve()
    named = {step.effect for step in found.steps}
    assert {"stribeck", "compliance"} <= named
    assert named <= {"stribeck", "compliance", "warmup", "drag_error"}  # what the bench has
    before = found.before["torque_nm"]
    first = next(step for step in found.steps if step.gap["torque_nm"] < 0.9 * before)
    assert {"stribeck", "drag_error", "warmup"} & {first.effect}  # dry, all three
    assert first.gap["torque_nm"] < 0.5 * before
    assert found.steps[-1].gap["transmission_m"] < 0.25 * found.before["transmission_m"]
    assert found.steps[-1].gap["torque_nm"] < 0.25 * found.before["torque_nm"]
    assert found.fitted["torque_nm"] > 0.7 * found.before["torque_nm"]
