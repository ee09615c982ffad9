"""The forms of a recording, told apart by their first bytes."""

import functools
import importlib
import pkgutil
from pathlib import Path

from .. import forms
from ..block import Source
from ..columns import TraceError
from ..sinumerik.controller_axis import ControllerAxis
from .foreign import named
from .form import Form

HEAD_BYTES = 1 << 16


@functools.cache
def all_forms() -> tuple[Form, ...]:
    """Every form that a module of this folder holds, in the order of asking."""
    names = sorted(module.name for module in pkgutil.iter_modules(forms.__path__))
    modules = [importlib.import_module(f"{forms.__name__}.{name}") for name in names]
    found = [module.FORM for module in modules if hasattr(module, "FORM")]
    return tuple(sorted(found, key=lambda form: form.rank))


def open_source(path: Path, axis: ControllerAxis) -> Source:
    """Open a file in the form that its content has. Raises TraceError and OSError."""
    head = head_of(path)
    form = _form(head, path)
    if form is None:
        raise TraceError(f"{path}: no trace but {named(head)}")
    return form.open(path, axis)


def head_of(path: Path) -> bytes:
    """First bytes of a file. Raises TraceError for a folder, and OSError."""
    if path.exists() and not path.is_file():
        names = ", ".join(form.name for form in all_forms())
        raise TraceError(f"{path}: a folder or device; expected a file: {names}")
    with path.open("rb") as file:
        return file.read(HEAD_BYTES)


def name_of(head: bytes, path: Path) -> str:
    """Name of what a file is by its first bytes: a form of recordings, or something else."""
    if not head.strip():
        return "nothing: the file is empty"
    form = _form(head, path)
    return named(head) if form is None else f"a recording, {form.name}"


def is_recording(path: Path) -> bool:
    """Tell whether a file has the form of a recording. Raises OSError."""
    return path.is_file() and _form(head_of(path), path) is not None


def _form(head: bytes, path: Path) -> Form | None:
    return next((form for form in all_forms() if form.recognises(head, path)), None)
