"""Machine code for the numeric kernels, kept between runs where a folder allows it."""

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

from .kernel_cache import KernelCache

_Function = TypeVar("_Function", bound=Callable[..., object])
_KERNEL_ROOMS = ("models", "downsample", "estimate")


def compiled(function: _Function) -> _Function:
    """Compile `function` with numba, on its first call for each set of argument types.

    Division by zero gives inf or nan, as in numpy. The plain Python function stays at hand as
    `.py_func`. The machine code is kept on disk; where numba finds no folder to write to (a
    read-only installation without a home) it is compiled anew in each process.
    """
    dispatcher = cast(Any, numba.njit)(error_model="numpy", nogil=True)(function)
    try:
        dispatcher._cache = KernelCache(function)
    except RuntimeError as error:
        if "cannot cache function" not in str(error):
            raise
    return cast(_Function, dispatcher)


def inlined(function: _Function) -> _Function:
    """As `compiled`, for what stands in an inner loop: it becomes part of whatever calls it.

    Arrays are not counted there, so it must neither make nor return one.
    """
    uncounted = cast(Any, numba.njit)(error_model="numpy", nogil=True, forceinline=True, _nrt=False)
    return cast(_Function, uncounted(function))


def _use_cache_of_these_sources() -> None:
    """Give numba a cache folder named after the kernels' sources.

    Numba's own check sees only the file of the function that is called first, not those of the
    functions inside: an edit or an upgrade there would go on running the old code.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    package = Path(__file__).parent.parent
    sources = sorted(path for room in _KERNEL_ROOMS for path in (package / room).rglob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111
    for base in (Path(home), Path(tempfile.gettempdir()) / f"edge-service-{os.getuid()}"):
        folder = base / "edge-service" / f"kernels-{digest}"
        try:
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        except OSError:
            continue
        if os.access(folder, os.W_OK) and folder.stat().st_uid == os.getuid():
            cast(Any, numba.config).CACHE_DIR = str(folder)
            return


_use_cache_of_these_sources()
