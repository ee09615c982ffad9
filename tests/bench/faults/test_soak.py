"""Tests of what the soak makes of its readings."""

import subprocess
import sys
from pathlib import Path

import pytest

from . import scene
from .scene import configuration, running_service
from .soak import MOST_MEMORY_MB, Look, look, slope_per_h


def looks(growth_bytes_per_s: float) -> list[Look]:
    """Readings that rise for a quarter of the time, and then by a rate."""
    times = [10.0 * k for k in range(40)]
    warm = 100.0
    return [
        Look(t, round(5e6 * min(t, warm) + growth_bytes_per_s * max(t - warm, 0.0)), 20, 9, 0)
        for t in times
    ]


@pytest.mark.parametrize("growth_bytes_per_s", [0.0, 250.0, -250.0])
def test_growth_is_that_after_the_warm_up(growth_bytes_per_s: float) -> None:
    slope = slope_per_h(looks(growth_bytes_per_s), "rss_bytes")
    assert slope == pytest.approx(3600.0 * growth_bytes_per_s, abs=5e3)


def test_what_does_not_change_does_not_grow() -> None:
    assert slope_per_h(looks(250.0), "descriptors") == pytest.approx(0.0, abs=1e-9)


UNUSED = (
    "aiomqtt",
    "asyncua",
    "charset_normalizer",
    "cryptography",
    "distributed",
    "filterpy",
    "httpx",
    "jinja2",
    "matplotlib",
    "mcap",
    "pyarrow",
    "pymodbus",
    "rich",
    "scipy.interpolate",
    "scipy.linalg",
    "scipy.signal",
    "scipy.sparse",
    "scipy.special",
    "tomlkit",
)
"""Packages that a service needs for what is configured or asked, if at all; numba loads `scipy`."""


def test_the_nodes_bring_along_no_package_that_a_plain_service_does_without() -> None:
    words = "import sys, edge_service.cli.entry, edge_service.nodes.service, drivers.replay; "
    loaded = subprocess.run(
        [sys.executable, "-c", f"{words}print(*sys.modules)"],
        capture_output=True,
        check=True,
        text=True,
    ).stdout.split()
    assert {"numba", "zenoh", "fastapi"} <= set(loaded)
    assert not set(UNUSED) & set(loaded)


@pytest.mark.slow
def test_two_axes_fit_while_kernels_are_missing_and_with_a_history_that_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scene, "KERNELS", tmp_path / "kernels")
    for _ in range(2):  # the second finds what the first has kept, and loads Arrow to read it
        _assert_that_two_axes_fit(tmp_path)


def _assert_that_two_axes_fit(folder: Path) -> None:
    axes = ("X", "Y")
    with running_service(configuration(axes, folder=folder / "history"), folder) as service:
        service.wait_ready(400.0)
        for _ in range(20):
            look(service, axes, 0.0)
        assert service.usage().peak_rss_bytes < 1e6 * MOST_MEMORY_MB
        assert not service.has_mapped("scipy/linalg")  # 40 MB that no kernel needs to run
        assert not service.has_mapped("scipy/special")
        assert not service.has_mapped("cryptography/")
