"""Intervals of shapes and amounts that only hold together: each is as wide as the others allow."""

import numpy as np
import pytest

from edge_service.diagnose.candidates.regressors import entry_regressor
from edge_service.diagnose.estimation.estimates import joined, slopes_of
from edge_service.diagnose.estimation.least_squares import Entries, WeightedLeastSquares
from edge_service.diagnose.session.session import TORQUE_GAP, TRANSMISSION_GAP
from edge_service.models.effects.registry import get_effect
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, session_of

AMOUNT_NM, SPEED_RAD_S, EXPONENT = 0.2, 8.0, 1.5
REGRESSOR = entry_regressor(
    get_effect("stribeck"), "excess_nm", {"speed_rad_s": SPEED_RAD_S, "exponent": EXPONENT}
)


@pytest.fixture(scope="module")
def system(machine: Machine) -> WeightedLeastSquares:
    session = session_of(machine, frame_of(recorded((), 3)))
    nothing = {name: np.zeros((len(rows.gap), 0)) for name, rows in session.channels.items()}
    weights = dict.fromkeys(session.channels, 1.0)
    return WeightedLeastSquares(session, weights, nothing, np.zeros(0), np.zeros(0), 400.0)


def test_slopes_are_the_derivatives_of_the_curve(system: WeightedLeastSquares) -> None:
    found = slopes_of(Entries.of(system, [REGRESSOR]), 0, np.array([AMOUNT_NM]))

    def expected(factor):
        def curve(motion):
            x = np.maximum(np.abs(motion.speed_rad_s) / SPEED_RAD_S, 1e-9)
            power = x**EXPONENT
            return AMOUNT_NM * motion.direction * power * np.exp(-power) * factor(x)

        return system.session.torque_column(curve)

    for name, factor in {
        "speed_rad_s": lambda x: EXPONENT,
        "exponent": lambda x: -EXPONENT * np.log(x),
    }.items():
        slope = found[name][TORQUE_GAP][:, 0]
        assert slope == pytest.approx(expected(factor), abs=2e-3 * float(np.abs(slope).max()))
        assert not np.any(found[name][TRANSMISSION_GAP])


def test_an_amount_is_less_sure_where_its_shapes_are_not_known(
    system: WeightedLeastSquares,
) -> None:
    entries = Entries.of(system, [REGRESSOR])
    slopes = slopes_of(entries, 0, np.array([AMOUNT_NM]))
    alone = entries.solve().covariance[0, 0]
    assert entries.solve(joined(system, slopes)).covariance[0, 0] > 1.1 * alone
    assert entries.solve(joined(system, {})).covariance[0, 0] == pytest.approx(alone)
