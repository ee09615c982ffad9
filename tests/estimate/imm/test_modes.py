"""The modes: their transitions in steps of any length, and the weighting of their probabilities."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from edge_service.estimate.imm.modes import moving_average, scaled_mode_transition, weighted_level

step_lengths = st.floats(1e-4, 2.0)


@settings(max_examples=25, deadline=None)
@given(step_lengths, step_lengths)
def test_two_steps_are_one_longer_step(first_s: float, second_s: float) -> None:
    first, second = scaled_mode_transition(first_s), scaled_mode_transition(second_s)
    assert (first >= 0.0).all()
    np.testing.assert_allclose(first.sum(axis=1), 1.0, atol=1e-14)
    both = scaled_mode_transition(first_s + second_s)
    np.testing.assert_allclose(first @ second, both, atol=1e-12)


LEVELS = np.array([10.0, 7.5, 5.0, 2.5, 0.0])


@st.composite
def probabilities(draw: st.DrawFn) -> np.ndarray:
    raw = draw(arrays(np.float64, 5, elements=st.floats(1e-6, 1.0)))
    return raw / raw.sum()


@given(probabilities())
def test_square_is_the_printed_function(mu: np.ndarray) -> None:
    weights = weighted_level(mu, np.eye(5), 2.0)
    np.testing.assert_allclose(weights, mu**2 / (mu**2).sum(), rtol=1e-12)


def test_the_printed_example() -> None:
    mu = np.array([0.04, 0.05, 0.85, 0.04, 0.03])  # sums to 1.01 in print (4.5.3)
    assert float(weighted_level(mu, LEVELS, 1.0)) * 1.01 == pytest.approx(5.125, abs=1e-12)


def test_published_prediction_follows_from_published_probabilities() -> None:
    mu = np.array([0.85, 0.07, 0.04, 0.03, 0.02])  # Table 4.2, 10 %
    assert float(weighted_level(mu, LEVELS)) == pytest.approx(9.7, abs=0.05)


series = arrays(np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.floats(-9, 9))


@given(series, st.integers(1, 40), st.data())
def test_moving_average_equals_the_definition(
    values: np.ndarray, steps: int, data: st.DataObject
) -> None:
    ahead = data.draw(st.integers(0, steps - 1))
    expected = [
        values[max(0, k - steps + 1 + ahead) : k + ahead + 1].mean(axis=0)
        for k in range(len(values))
    ]
    np.testing.assert_allclose(moving_average(values, steps, ahead), expected, atol=1e-12)
