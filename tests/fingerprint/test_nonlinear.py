"""Intervals by profile likelihood end, and hold what they should, where curvature says nothing."""

import numpy as np
import pytest

from edge_service.regression.nonlinear import Unknown, fit_profiled


@pytest.mark.parametrize("jump", [30.0, 1e10])
def test_a_bound_is_found_where_the_misfit_jumps_beside_the_optimum(jump: float) -> None:
    """A jump looks like endless curvature: the bracket was finer than the numbers, for ever."""

    def residual(values: np.ndarray) -> np.ndarray:
        away = values[0] - 1.0
        return np.array([jump * float(away != 0.0), away, 0.5 * away, 0.0])

    unknown = Unknown("level", 0.0, 2.0, "N m")
    found = fit_profiled(residual, [unknown], [np.array([1.0])]).parameters["level"]
    assert found.low <= 1.0 <= found.high
    assert found.value == pytest.approx(1.0)
