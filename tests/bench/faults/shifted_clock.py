"""The service with a clock that a file shifts, so that hours pass in seconds.

EDGE_SERVICE_CLOCK=FILE python -m tests.bench.faults.shifted_clock run edge.toml
"""

import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

VARIABLE = "EDGE_SERVICE_CLOCK"
_READ_PERIOD_S = 0.1


def shift_clock(path: Path) -> None:
    """Let the wall clock, and the one that counts a suspended host, be ahead by a file's seconds.

    To the service hours pass as if the host had slept; a step of the wall clock alone would not be
    believed.
    """
    real_s, real_ns, real_clock_ns = time.time, time.time_ns, time.clock_gettime_ns
    offset_s = _offset(path)
    time.time = lambda: real_s() + offset_s()
    time.time_ns = lambda: real_ns() + round(offset_s() * 1e9)
    time.clock_gettime_ns = lambda clock: real_clock_ns(clock) + round(offset_s() * 1e9)


def _offset(path: Path) -> Callable[[], float]:
    last = [0.0, float("-inf")]

    def offset_s() -> float:
        now_s = time.monotonic()
        if now_s - last[1] > _READ_PERIOD_S:
            last[1] = now_s
            with suppress(OSError):  # no descriptor is left: the shift stays as it is
                last[0] = float(path.read_text())
        return last[0]

    return offset_s


if __name__ == "__main__":
    shift_clock(Path(os.environ[VARIABLE]))
    from edge_service.cli.entry import main

    raise SystemExit(main())
