"""Every parameter of a simulated axis is found, and intervals hold the truth as often as said."""

import pytest
from scipy import stats

from .bench import run, table_of
from .cases import recoveries

RARE = 1e-4


def test_one_axis_finds_every_parameter_near_its_truth() -> None:
    found = recoveries(7)
    groups = {name.split(".")[0] for name in found}
    assert groups == {"rigid", "friction", "two_masses", "stretch", "stretch_with_play"}
    for name, each in found.items():
        assert each.found.determined, name
        assert abs(each.found.value - each.truth) < 5.0 * each.found.sigma, name
        assert each.truth == 0.0 or each.found.sigma < 0.05 * abs(each.truth), name


@pytest.mark.slow
def test_coverage_over_many_axes() -> None:
    found = run(40)
    for each in found:
        assert each.undetermined == 0, each.name
        assert each.held >= stats.binom.ppf(RARE, each.count, 0.93), each
        assert abs(each.bias_sigma) < 1.0, each
    held = sum(each.held for each in found)
    count = sum(each.count for each in found)
    assert 0.93 < held / count < 0.985
    assert f"{held} of {count} intervals hold the truth" in str(table_of(found))
