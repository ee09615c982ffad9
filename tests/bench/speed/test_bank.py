import pytest

from .bank import measure_estimator_speed


@pytest.mark.slow
def test_speeds_are_there_and_their_ratios_belong_to_them() -> None:
    speed = measure_estimator_speed(repeats=3)
    assert speed.filterpy_steps_per_s > 0.0
    batch, single = speed.batch_steps_per_s, speed.single_steps_per_s
    assert speed.batch_over_filterpy == pytest.approx(batch / speed.filterpy_steps_per_s, rel=0.5)
    assert speed.single_over_filterpy == pytest.approx(single / speed.filterpy_steps_per_s, rel=0.5)
