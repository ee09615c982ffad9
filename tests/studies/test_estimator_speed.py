import pytest

from edge_service.studies.estimator_speed import measure_estimator_speed


@pytest.mark.slow
def test_the_kernel_is_far_faster_than_filterpy() -> None:
    speed = measure_estimator_speed(repeats=3)
    assert speed.batch_over_filterpy > 100.0
    assert speed.single_over_filterpy > 3.0
