"""Machine code for the numeric kernels, kept between runs by numba's own cache."""

import hashlib
import os
import shutil
import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., object])
_KERNEL_ROOMS = ("models", "checks", "downsample", "estimate")
_ROOM_BYTES = 50_000_000


def compiled(function: _Function, *, reordered: bool = False) -> _Function:
    """Compile `function` with numba, on its first call for each set of argument types.

    Division by zero gives inf or nan, as in numpy. `.py_func` is the plain Python function. Kernels
    of the models let other threads work, and those whose sums may be `reordered` for speed. Without
    a safe folder each process compiles anew.
    """
    kept, long = bool(cast(Any, numba.config).CACHE_DIR), ".models." in function.__module__
    free = {"nogil": long or reordered, "fastmath": {"reassoc"} if reordered else False}
    made = cast(Any, numba.njit)(error_model="numpy", cache=kept, **free)
    return cast(_Function, made(function))


def inlined(function: _Function) -> _Function:
    """As `compiled`, for what stands in an inner loop: it becomes part of whatever calls it.

    Arrays are not counted there, so it must neither make nor return one.
    """
    uncounted = cast(Any, numba.njit)(error_model="numpy", nogil=True, forceinline=True, _nrt=False)
    return cast(_Function, uncounted(function))


def cache_folder() -> Path | None:
    """Folder for machine code that nobody but this user, or root, can change; None without one.

    Numba unpickles what it finds there, so another user's file would be run. The folder is named
    after the kernels' sources, because numba sees only changes of the function that is called
    first, not of those inside.
    """
    base = os.environ.get("CACHE_DIRECTORY") or os.path.expanduser("~/.cache/edge-service")  # noqa: PTH111
    package = Path(__file__).parent.parent
    sources = sorted(path for room in _KERNEL_ROOMS for path in (package / room).rglob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    try:
        folder = Path(base).resolve() / f"kernels-{digest}"
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if not all(is_private(place) for place in (folder, *folder.parents)):
            return None
        for path in folder.rglob("*.nb?"):
            if path.stat().st_size == 0:  # as a power cut leaves it; numba would stop there
                path.unlink()
        roomy = shutil.disk_usage(folder).free > _ROOM_BYTES  # numba fails on a full disk
    except OSError:
        return None
    return folder if roomy and os.access(folder, os.W_OK) else None


def is_private(folder: Path) -> bool:
    """Return whether this user or root owns the folder, and nobody else may write to it."""
    status = folder.lstat()
    return status.st_uid in {0, os.getuid()} and not status.st_mode & 0o022


if "scipy.linalg" not in sys.modules:  # which Numba looks for at once; kernels that need it do too
    sys.modules["scipy.linalg"] = cast(Any, None)
    import numba.np.arraymath

    del sys.modules["scipy.linalg"]
if numba.__version__.startswith("0.68."):  # others are left alone: nobody promises these names
    # its counters of arrays cost 20 MB of LLVM's code at once; kept kernels hold their own
    _runtime = cast(Any, numba).core.runtime
    _compile = _runtime.nrtdynmod.compile_nrt_functions
    _runtime.nrtdynmod.compile_nrt_functions = lambda context: cache(partial(_compile, context))
    type(_runtime.rtsys).library = property(lambda runtime: runtime._library())
if not os.environ.get("NUMBA_CACHE_DIR"):
    cast(Any, numba.config).CACHE_DIR = str(cache_folder() or "")
