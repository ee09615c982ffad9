import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.integrate import solve_ivp

from tests.bench.oracles.state_space import LinearModel, TransferFunction

PERIOD_S = 2e-3
FREQUENCIES_HZ = np.geomspace(0.1, 200.0, 40)


def oscillator(frequency_hz: float, damping_ratio: float) -> LinearModel:
    """x'' + 2 z w x' + w^2 x = w^2 u; outputs x and x'' (which needs the feedthrough)."""
    w = 2.0 * math.pi * frequency_hz
    pull = [-(w**2), -2.0 * damping_ratio * w]
    return LinearModel(
        state_matrix=np.array([[0.0, 1.0], pull]),
        input_matrix=np.array([[0.0], [w**2]]),
        output_matrix=np.array([[1.0, 0.0], pull]),
        feedthrough=np.array([[0.0], [w**2]]),
        inputs=("u",),
        outputs=("position", "acceleration"),
    )


def matrices(model: LinearModel) -> tuple[np.ndarray, ...]:
    return (model.state_matrix, model.input_matrix, model.output_matrix, model.feedthrough)


def test_sampled_oscillator_has_the_closed_form_transition() -> None:
    frequency_hz, damping = 20.0, 0.1
    w = 2.0 * math.pi * frequency_hz
    wd, decay = w * math.sqrt(1.0 - damping**2), math.exp(-damping * w * PERIOD_S)
    c, s = math.cos(wd * PERIOD_S), math.sin(wd * PERIOD_S)
    expected = decay * np.array(
        [[c + damping * w / wd * s, s / wd], [-(w**2) / wd * s, c - damping * w / wd * s]]
    )
    sampled = oscillator(frequency_hz, damping).sampled(PERIOD_S)
    np.testing.assert_allclose(sampled.state_matrix, expected, rtol=1e-9)
    np.testing.assert_allclose(sampled.input_matrix[0, 0], 1.0 - expected[0, 0], rtol=1e-9)


def test_response_to_held_inputs_is_that_of_the_differential_equation() -> None:
    model, random = oscillator(15.0, 0.05), np.random.default_rng(2)
    inputs = random.standard_normal((25, 1))
    start = np.array([0.3, -4.0])
    outputs = model.sampled(PERIOD_S).respond(inputs, start)
    state = start
    for k, push in enumerate(inputs):
        expected = model.output_matrix @ state + model.feedthrough @ push
        np.testing.assert_allclose(outputs[k], expected, rtol=1e-7, atol=1e-6)
        solution = solve_ivp(
            lambda _, x, u=push: model.state_matrix @ x + model.input_matrix @ u,
            (0.0, PERIOD_S),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        )
        state = solution.y[:, -1]


def test_response_and_frequency_response_agree_with_scipy() -> None:
    model = oscillator(15.0, 0.05)
    sampled = model.sampled(PERIOD_S)
    inputs = np.random.default_rng(4).standard_normal((60, 1))
    _, outputs, _ = signal.dlsim((*matrices(sampled), PERIOD_S), inputs)
    np.testing.assert_allclose(sampled.respond(inputs), outputs, rtol=1e-9, atol=1e-9)
    w = 2.0 * math.pi * 15.0
    _, response = signal.freqs([w**2], [1.0, 0.1 * w, w**2], 2.0 * np.pi * FREQUENCIES_HZ)
    np.testing.assert_allclose(model.frequency_response(FREQUENCIES_HZ)[:, 0, 0], response)


@pytest.mark.parametrize("period_s", [None, PERIOD_S])
def test_transfer_function_and_state_space_have_one_frequency_response(
    period_s: float | None,
) -> None:
    model = oscillator(15.0, 0.05)
    model = model if period_s is None else model.sampled(period_s)
    for row, output in enumerate(model.outputs):
        ratio = model.transfer_function(output, "u").frequency_response(FREQUENCIES_HZ)
        direct = model.frequency_response(FREQUENCIES_HZ)[:, row, 0]
        np.testing.assert_allclose(ratio, direct, rtol=1e-6, atol=1e-9)


@settings(deadline=None)
@given(frequency_hz=st.floats(1.0, 200.0), damping=st.floats(0.001, 0.9))
def test_resonance_is_found_before_and_after_sampling(frequency_hz: float, damping: float) -> None:
    model = oscillator(frequency_hz, damping)
    for one in (model, model.sampled(1e-3)):
        (resonance,) = one.resonances()
        assert resonance.frequency_hz == pytest.approx(frequency_hz, rel=1e-6)
        assert resonance.damping_ratio == pytest.approx(damping, rel=1e-5)


def test_overdamped_pair_is_no_resonance() -> None:
    assert oscillator(10.0, 1.5).resonances() == ()


def test_static_gain_is_the_end_of_a_step() -> None:
    model = oscillator(15.0, 0.3)
    for one in (model, model.sampled(PERIOD_S)):
        assert one.transfer_function("position", "u").static_gain() == pytest.approx(1.0)
    ends = model.sampled(PERIOD_S).respond(np.ones((2000, 1)))[-1]
    np.testing.assert_allclose(ends, [1.0, 0.0], atol=1e-8)


def test_integrator_has_no_static_gain_but_the_sign_of_its_drift() -> None:
    assert TransferFunction(np.array([2.0]), np.array([1.0, 0.0])).static_gain() == math.inf
    falling = TransferFunction(np.array([-2.0]), np.array([1.0, -1.0]), period_s=0.1)
    assert falling.static_gain() == -math.inf


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda m: m.frequency_response(np.array([0.0])), "frequency_hz"),
        (lambda m: m.transfer_function("u", "u"), "u: no such signal; there are position"),
        (lambda m: m.transfer_function("position", "v"), "v: no such signal; there are u"),
        (lambda m: m.sampled(0.0), "period_s"),
        (lambda m: m.sampled(0.1).sampled(0.1), "the model is sampled already"),
        (lambda m: m.respond(np.ones((5, 1))), "the model is continuous"),
        (lambda m: m.sampled(0.1).respond(np.ones((5, 2))), "expected inputs of shape"),
        (lambda m: m.sampled(0.1).respond(np.ones((5, 1)), np.ones(3)), "expected inputs"),
        (
            lambda m: LinearModel(*matrices(m)[:3], np.zeros((1, 1)), m.inputs, m.outputs),
            "feedthrough: expected finite numbers of shape",
        ),
    ],
)
def test_misuse_gives_one_line(call: Callable[[LinearModel], object], word: str) -> None:
    with pytest.raises(ValueError, match=f"^{word}[^\n]*$"):
        call(oscillator(10.0, 0.1))
