"""Memory of a service: what was big and is done with goes back to the machine."""

import ctypes
import os

from .kernels import compile_in_another_process

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
"""Options of mallopt(3)."""
_BIG_BYTES = 128 * 1024


def stay_small() -> None:
    """Bound what this process keeps from now on.

    The C library learns from each big array to keep the next one, in as many arenas as there are
    threads; here it keeps none. Compilers keep their thoughts; here others compile.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # of glibc alone
    if mallopt is not None:
        mallopt(_ARENA_MAX, 2)
        mallopt(_MMAP_THRESHOLD, _BIG_BYTES)
        mallopt(_TRIM_THRESHOLD, _BIG_BYTES)
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # its own keeps a heap per thread
    compile_in_another_process()
