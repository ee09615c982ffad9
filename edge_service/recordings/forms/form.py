"""Description by a module of this folder of the form that it reads."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..block import Source
from ..sinumerik.controller_axis import ControllerAxis


@dataclass(frozen=True, slots=True)
class Form:
    """One form of recordings; its module holds it as `FORM`.

    Attributes:
        name: in words.
        recognises: tells by a file's first bytes and its name whether it has this form.
        open: opens a file of it. Raises TraceError and OSError.
        rank: forms of a lower one are asked first.
    """

    name: str
    recognises: Callable[[bytes, Path], bool]
    open: Callable[[Path, ControllerAxis], Source]
    rank: int = 0
