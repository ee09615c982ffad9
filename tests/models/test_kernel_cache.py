"""Machine code on disk: damage costs time, never an answer."""

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys

from edge_service.models import kernel_cache
from edge_service.models.compiled import compiled


def twice(number: float) -> float:
    return 2.0 * number


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    rtsys.initialize(cpu_target.target_context)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernel_cache, "_elsewhere", [])
    yield tmp_path


def fresh() -> Any:
    """The kernel as another process would meet it."""
    return compiled(twice)


def hits(kernel: Any) -> int:
    assert kernel(3.0) == 6.0
    return sum(kernel.stats.cache_hits.values())


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*.nb?"))


def test_a_second_process_compiles_nothing() -> None:
    assert [hits(fresh()), hits(fresh())] == [0, 1]


def damaged(content: bytes) -> Iterator[bytes]:
    """Cut at the ends and within, one bit flipped in every part."""
    for share in (0.0, 0.1, 0.5, 0.999):
        at = round(share * len(content))
        yield content[:at]
        yield content[:at] + bytes([content[at] ^ 16]) + content[at + 1 :]


def test_damage_anywhere_is_compiled_anew(folder: Path) -> None:
    fresh()(3.0)
    for number in range(len(files(folder))):
        for content in damaged(files(folder)[number].read_bytes()):
            files(folder)[number].write_bytes(content)
            assert [hits(fresh()), hits(fresh())] == [0, 1], files(folder)[number].name


def test_a_disk_that_takes_nothing_costs_time_only(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(kernel_cache._CheckedFiles, "_save_data", full)
    assert [hits(fresh()), hits(fresh())] == [0, 0]


def test_what_is_missing_is_ordered_elsewhere_and_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    orders: list[bytes] = []

    def elsewhere(order: bytes) -> bool:
        orders.append(order)
        monkeypatch.setattr(kernel_cache, "_elsewhere", [])
        module, name, types = pickle.loads(order)
        assert (module, name) == (__name__, "twice")
        fresh().compile(types)
        return True

    kernel_cache.make_elsewhere(elsewhere)
    assert hits(fresh()) == 1
    assert len(orders) == 1


@pytest.mark.parametrize("claims", [True, False])
def test_who_cannot_compile_elsewhere_is_asked_once(claims: bool) -> None:
    orders: list[bytes] = []
    kernel_cache.make_elsewhere(lambda order: bool(orders.append(order)) or claims)
    assert [hits(fresh()), hits(fresh())] == [0, 1]
    assert len(orders) == 1


_PROCESS = """
import sys
import numpy as np
from numba.core.runtime import nrtdynmod
from edge_service.downsample.interval_kernels import reversals
from edge_service.models import kernel_cache

make, made, orders = nrtdynmod.create_nrt_module, [], []

def counted(target):
    made.append(target)
    return make(target)

def elsewhere(order):
    orders.append(order)
    return False

nrtdynmod.create_nrt_module = counted
if "elsewhere" in sys.argv:
    kernel_cache.make_elsewhere(elsewhere)
assert np.all(reversals(np.array([0.0, 1.0, 0.0, 1.0]), 0.5) == reversals.py_func(
    np.array([0.0, 1.0, 0.0, 1.0]), 0.5
))
print(len(made), len(orders), sum(reversals.stats.cache_hits.values()))
"""


def numbers_of_a_process(folder: Path, *words: str) -> list[int]:
    """How often it compiled the counting of references, ordered, and loaded a kernel."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
    done = subprocess.run(
        [sys.executable, "-c", _PROCESS, *words],
        env=environment,
        capture_output=True,
        check=True,
        text=True,
    )
    return [int(number) for number in done.stdout.split()]


@pytest.mark.slow
def test_what_counts_references_is_compiled_once_and_again_where_it_is_damaged(
    folder: Path,
) -> None:
    assert numbers_of_a_process(folder) == [1, 0, 0]
    assert numbers_of_a_process(folder) == [0, 0, 1]
    (kept,) = folder.glob("counting.*.nbc")
    content = kept.read_bytes()
    kept.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert numbers_of_a_process(folder, "elsewhere") == [1, 1, 1]  # nobody else could do it
    assert kept.read_bytes() == content
    assert numbers_of_a_process(folder, "elsewhere") == [0, 0, 1]
