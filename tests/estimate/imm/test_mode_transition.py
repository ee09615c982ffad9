import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, fractional_matrix_power, logm

from edge_service.estimate.imm.bank.mode_transition import (
    THESIS_MODE_TRANSITION,
    scaled_mode_transition,
    transition_rates,
)

step_lengths = st.floats(1e-4, 2.0)


@settings(max_examples=25, deadline=None)
@given(step_lengths)
def test_rows_stay_probability_distributions(step_s: float) -> None:
    scaled = scaled_mode_transition(THESIS_MODE_TRANSITION, step_s)
    assert (scaled >= 0.0).all()
    np.testing.assert_allclose(scaled.sum(axis=1), 1.0, atol=1e-14)


@settings(max_examples=25, deadline=None)
@given(step_lengths, step_lengths)
def test_two_steps_are_one_longer_step(first_s: float, second_s: float) -> None:
    both = scaled_mode_transition(THESIS_MODE_TRANSITION, first_s) @ scaled_mode_transition(
        THESIS_MODE_TRANSITION, second_s
    )
    np.testing.assert_allclose(
        both, scaled_mode_transition(THESIS_MODE_TRANSITION, first_s + second_s), atol=1e-12
    )


def test_reference_step_gives_the_matrix_back() -> None:
    np.testing.assert_allclose(
        scaled_mode_transition(THESIS_MODE_TRANSITION, 0.1), THESIS_MODE_TRANSITION, atol=1e-13
    )


@pytest.mark.parametrize("step_s", [0.001, 0.01, 0.05, 0.25])
def test_equals_a_fractional_matrix_power(step_s: float) -> None:
    np.testing.assert_allclose(
        scaled_mode_transition(THESIS_MODE_TRANSITION, step_s),
        fractional_matrix_power(THESIS_MODE_TRANSITION, step_s / 0.1),
        atol=1e-12,
    )


def test_eigenvectors_that_are_nearly_parallel_are_left_to_scipy() -> None:
    alone = np.array([[0.6, 0.4, 0.0], [0.0, 0.6 + 1e-9, 0.4 - 1e-9], [0.0, 0.0, 1.0]])
    scaled = np.maximum(logm(alone).real, 0.0)
    np.fill_diagonal(scaled, 0.0)
    np.fill_diagonal(scaled, -scaled.sum(axis=1))
    np.testing.assert_allclose(transition_rates(alone, 1.0), scaled, atol=1e-12)
    expected = np.maximum(expm(scaled), 0.0)
    np.testing.assert_allclose(
        scaled_mode_transition(alone, 1.0, 1.0),
        expected / expected.sum(axis=1, keepdims=True),
        atol=1e-12,
    )


def test_printed_rates_are_those_of_a_markov_chain() -> None:
    rates = transition_rates(THESIS_MODE_TRANSITION)
    assert (rates[~np.eye(5, dtype=bool)] > 0.0).all()
    np.testing.assert_allclose(rates.sum(axis=1), 0.0, atol=1e-12)


def test_two_mode_chain_matches_its_closed_form() -> None:
    a, b, ratio = 0.1, 0.3, 0.25
    kept = (1.0 - a - b) ** ratio  # second eigenvalue of the chain
    expected = np.array([[b + a * kept, a - a * kept], [b - b * kept, a + b * kept]]) / (a + b)
    scaled = scaled_mode_transition(np.array([[1 - a, a], [b, 1 - b]]), ratio, reference_s=1.0)
    np.testing.assert_allclose(scaled, expected, atol=1e-14)


def test_a_chain_without_generator_is_still_scaled_to_a_chain() -> None:
    three_in_a_row = np.array([[0.6, 0.4, 0.0], [0.0, 0.6, 0.4], [0.0, 0.0, 1.0]])
    skipping = np.array([[0.6, 0.39, 0.01], [0.0, 0.6, 0.4], [0.0, 0.0, 1.0]])
    for matrix in (three_in_a_row, skipping):
        scaled = scaled_mode_transition(matrix, 0.05)
        assert (scaled >= 0.0).all()
        np.testing.assert_allclose(scaled.sum(axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (np.array([[0.0, 1.0], [1.0, 0.0]]), "no real logarithm"),
        (np.array([[0.5, 0.5], [0.5, 0.5]]), "singular"),
        (np.array([[0.8, 0.3], [0.1, 0.9]]), "sum to 1"),
        (np.array([[1.1, -0.1], [0.1, 0.9]]), "non-negative"),
    ],
)
def test_impossible_matrices_are_refused(matrix: np.ndarray, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        scaled_mode_transition(matrix, 0.01)


@pytest.mark.parametrize("step_s", [0.0, -0.1, float("nan"), float("inf")])
def test_impossible_steps_are_refused(step_s: float) -> None:
    with pytest.raises(ValueError, match="step_s"):
        scaled_mode_transition(THESIS_MODE_TRANSITION, step_s)
