"""Arrays and numbers in JSON documents.

An array is nested lists of numbers, or text that is bit for bit the same and takes a tenth of the
time and half of the size.
"""

import math
from base64 import b64decode, b64encode
from typing import Annotated, Any, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import PlainSerializer, PlainValidator

from .samples import Floats

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


def _to_floats(value: Any) -> Floats:
    try:
        return np.array(value, np.float64)
    except TypeError as error:
        raise ValueError(str(error)) from None


StoredFloats = Annotated[
    Floats, PlainValidator(_to_floats), PlainSerializer(lambda array: array.tolist())
]
"""Array of a stored dataclass, as nested lists."""
