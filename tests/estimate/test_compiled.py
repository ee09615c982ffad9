import sys
from pathlib import Path

import pytest

from edge_service.models.compiled import cache_folder, compiled, is_private
from tests.programs import printed

KERNEL = """
import numba
from edge_service.models.screw.nut_law import nut_stiffness
assert nut_stiffness(1.6e8, 10.0) == nut_stiffness.py_func(1.6e8, 10.0)
print(numba.config.CACHE_DIR, sum(nut_stiffness.stats.cache_hits.values()))
"""


def test_division_by_zero_is_as_in_numpy() -> None:
    def inverse(x: float) -> float:
        return 1.0 / x

    assert compiled(inverse)(0.0) == float("inf")


def test_machine_code_is_never_kept_where_others_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = tmp_path / "shared"
    for mode, private in ((0o700, True), (0o755, True), (0o775, False), (0o1777, False)):
        shared.mkdir(exist_ok=True)
        shared.chmod(mode)
        assert is_private(shared) is private
    monkeypatch.setenv("CACHE_DIRECTORY", str(shared / "mine"))
    assert cache_folder() is None


def test_a_second_process_compiles_nothing(tmp_path: Path) -> None:
    def hits() -> list[str]:
        return printed(sys.executable, "-c", KERNEL, NUMBA_CACHE_DIR=str(tmp_path)).split()

    assert [hits(), hits()] == [[str(tmp_path), "0"], [str(tmp_path), "1"]]
