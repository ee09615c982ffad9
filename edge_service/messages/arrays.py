"""Arrays in JSON, bit for bit (a tenth of the time, half of the size of decimals), and numbers."""

import math
from base64 import b64decode, b64encode
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

_Scalar = TypeVar("_Scalar", bound=np.generic)


def encoded(array: npt.NDArray[Any]) -> str:
    """The bytes of an array, in its order, as base64."""
    return b64encode(array.tobytes()).decode("ascii")


def decoded(text: str, dtype: "type[_Scalar] | np.dtype[_Scalar]") -> npt.NDArray[_Scalar]:
    """Array that was encoded, (n,), to be written to. Raises ValueError."""
    return np.frombuffer(b64decode(text, validate=True), dtype=dtype).copy()


def finite_or_none(value: float) -> float | None:
    """A number for JSON, which has neither NaN nor infinity: null stands for both."""
    return value if math.isfinite(value) else None
