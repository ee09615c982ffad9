"""Stored state: a dataclass as JSON-able values and back, every number bit for bit.

JSON has neither NaN nor infinity: null and the texts `inf` and `-inf` stand for them.
"""

import math
from base64 import b64decode, b64encode
from collections.abc import Mapping
from typing import Annotated, Any, Generic, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import BeforeValidator, PlainSerializer, PlainValidator, TypeAdapter, ValidationError

from .samples import Floats

T = TypeVar("T")
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


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return str(value) if math.isinf(value) else finite_or_none(value)


def _to_floats(values: Any) -> Floats:
    try:
        return np.array([*values], np.float64)
    except TypeError as error:
        raise ValueError(str(error)) from None


Number = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(_plain),
]
"""Number of a stored dataclass that need not be finite."""
StoredFloats = Annotated[
    Floats,
    PlainValidator(_to_floats),
    PlainSerializer(lambda array: _plain(array.tolist())),
]
"""Array of a stored dataclass, as nested lists."""


class Stored(Generic[T]):
    """Round trip of one type, chiefly a dataclass.

    Its fields have the types of this module, or plain ones. A default is that of a new state; a
    value that is missing where one is stored is an error.
    """

    def __init__(self, of: Any) -> None:
        self._adapter: TypeAdapter[T] = TypeAdapter(of)

    def dump(self, state: T) -> Any:
        """JSON-able values of a state."""
        return self._adapter.dump_python(state, by_alias=True)

    def load(self, values: Any) -> T:
        """State of such values. Raises ValueError if they are of another type or damaged."""
        try:
            state = self._adapter.validate_python(values)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise ValueError(f"a damaged snapshot: {place}: {first['msg']}") from None
        if isinstance(values, Mapping) and (missing := _missing(self.dump(state), values)):
            raise ValueError(f"a damaged snapshot: {missing} missing")
        return state


def _missing(whole: Any, values: Any, place: str = "") -> str:
    """First key that one of the tables should have and has not; empty without one."""
    if isinstance(whole, Mapping):
        for key, value in whole.items():
            held = key if key in values else str(key)  # JSON turns every key into text
            if held not in values:
                return f"{place}{key}"
            if found := _missing(value, values[held], f"{place}{key}."):
                return found
    return ""
