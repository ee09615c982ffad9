import math

import pytest

from edge_service.models.screw.friction import exponential_friction


def test_exponential_form_jumps_at_rest_and_falls_to_the_coulomb_level() -> None:
    def level(share: float) -> float:
        return float(exponential_friction(share * 0.01, 60.0, 90.0, 0.01))

    assert (level(1e-9), level(0.0), level(-1e-9)) == pytest.approx((90.0, 0.0, -90.0))
    assert level(1.0) == pytest.approx(60.0 + 30.0 / math.e)
    assert level(-2.0) == pytest.approx(-60.0 - 30.0 / math.e**4)
    assert exponential_friction(-0.5, 60.0, 90.0, 0.01, 200.0) == pytest.approx(-160.0)
