import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import fractional_matrix_power

from edge_service.estimate.imm.mode_transition import (
    THESIS_MODE_TRANSITION,
    scaled_mode_transition,
)

step_lengths = st.floats(1e-4, 2.0)


@settings(max_examples=25, deadline=None)
@given(step_lengths, step_lengths)
def test_two_steps_are_one_longer_step(first_s: float, second_s: float) -> None:
    first, second = scaled_mode_transition(first_s), scaled_mode_transition(second_s)
    assert (first >= 0.0).all()
    np.testing.assert_allclose(first.sum(axis=1), 1.0, atol=1e-14)
    both = scaled_mode_transition(first_s + second_s)
    np.testing.assert_allclose(first @ second, both, atol=1e-12)


@pytest.mark.parametrize("step_s", [0.001, 0.01, 0.1, 0.25])
def test_equals_a_fractional_matrix_power(step_s: float) -> None:
    expected = fractional_matrix_power(THESIS_MODE_TRANSITION, step_s / 0.1)
    np.testing.assert_allclose(scaled_mode_transition(step_s), expected, atol=1e-12)
