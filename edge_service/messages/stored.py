"""Stored state: a dataclass as JSON-able values and back, every number bit for bit.

JSON has no NaN and no infinity: a field that may hold one says by its type what stands for it.
"""

import math
from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Annotated, Any, Generic, TypeVar, get_type_hints

import numpy as np
import numpy.typing as npt
from pydantic import (
    BeforeValidator,
    GetCoreSchemaHandler,
    PlainSerializer,
    PlainValidator,
    TypeAdapter,
    ValidationError,
)
from pydantic_core import core_schema

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


T = TypeVar("T")
_PLAIN = (float, int, bool)


class Stored(Generic[T]):
    """Round trip of one type, chiefly a dataclass.

    Args:
        of: its fields have the types of this module, or plain ones. A default is that of a new
            state; a value that is missing where one is stored is an error.
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
        if isinstance(values, Mapping) and (missing := set(self.dump(state)) - set(values)):
            raise ValueError(f"a damaged snapshot: {', '.join(sorted(missing))} missing")
        return state


class Packed:
    """Mark of a dataclass of numbers, also nested, that is stored as the bits of one array."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(
            partial(_unpacked, source),
            serialization=core_schema.plain_serializer_function_ser_schema(_packed),
        )


def _packed(record: Any) -> str:
    return encoded(np.array(list(_numbers(record)), dtype=np.float64))


def _numbers(record: Any) -> Iterator[float]:
    for field in fields(record):
        value = getattr(record, field.name)
        yield from _numbers(value) if is_dataclass(value) else (value,)


def _unpacked(of: type[Any], text: object) -> Any:
    if not isinstance(text, str):
        raise ValueError("expected text")
    numbers = iter(decoded(text, np.float64).tolist())
    record = _record(of, numbers)
    if next(numbers, None) is not None:
        raise ValueError(f"more numbers than a {of.__name__} has")
    return record


def _record(of: type[Any], numbers: Iterator[float]) -> Any:
    try:
        values = (
            kind(next(numbers)) if kind in _PLAIN else _record(kind, numbers)
            for kind in get_type_hints(of).values()
        )
        return of(*values)
    except RuntimeError:  # StopIteration within the generator
        raise ValueError(f"fewer numbers than a {of.__name__} has") from None


def _logs(array: Floats) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in array]


def _logarithms(values: object) -> Floats:
    if not isinstance(values, list):
        raise ValueError("expected a list")
    return _array([-np.inf if value is None else value for value in values])


def _array(values: Any) -> Floats:
    return np.array(values, dtype=np.float64)


Number = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    PlainSerializer(lambda value: None if math.isnan(value) else value),
]
"""NaN as None."""
Since = Annotated[
    float,
    BeforeValidator(lambda value: -math.inf if value is None else value),
    PlainSerializer(lambda value: None if value == -math.inf else value),
]
"""Time of the last event, minus infinity, before the first one, as None."""
Decimals = Annotated[Floats, PlainValidator(_array), PlainSerializer(lambda array: array.tolist())]
"""Array of finite numbers as nested lists."""
Logarithms = Annotated[
    Floats,
    PlainValidator(_logarithms),
    PlainSerializer(_logs),
]
"""Array (n,) of logarithms, that of zero as None."""
