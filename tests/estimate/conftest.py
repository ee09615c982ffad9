"""Known limits of the estimator."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent
LIMITS = {
    "test_what_the_model_does_not_know_is_not_taken_for_a_loss[backlash": (
        "a known limit: see edge_service/estimate/README.md"
    ),
    "test_preload_does_not_come_back_over_night_on_a_cold_axis[True]": (
        "another nut after a night is recognised only in part"
    ),
}
"""Cases that the estimator does not solve yet (its README, Limits)."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Expect the cases beyond the estimator's known limits to fail, and run them all the same."""
    for item in items:
        for case, reason in LIMITS.items():
            if HERE in item.path.parents and item.name.startswith(case):
                item.add_marker(pytest.mark.xfail(reason=reason, strict=False))
