from collections.abc import Callable
from typing import Any

import pytest

from edge_service.models import compiled as module
from edge_service.models.compiled import compiled


def double(x: float) -> float:
    return 2.0 * x


def test_compiles_and_keeps_the_python_function() -> None:
    fast: Any = compiled(double)
    assert fast(1.5) == 3.0
    assert fast.py_func is double


def test_division_by_zero_is_as_in_numpy() -> None:
    def inverse(x: float) -> float:
        return 1.0 / x

    assert compiled(inverse)(0.0) == float("inf")


def refusing(message: str) -> Callable[[Any], Any]:
    def cache(_function: Any) -> Any:
        raise RuntimeError(message)

    return cache


def test_works_without_a_folder_for_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    message = "cannot cache function 'double': no locator available"
    monkeypatch.setattr(module, "KernelCache", refusing(message))
    fast: Any = compiled(double)
    assert (fast(1.5), fast.py_func) == (3.0, double)


def test_other_errors_are_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KernelCache", refusing("something else"))
    with pytest.raises(RuntimeError, match="something else"):
        compiled(double)
