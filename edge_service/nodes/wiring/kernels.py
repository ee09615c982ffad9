"""Numeric kernels compiled by a process that ends, which leaves its memory to the machine.

The module is also that process, `python -m edge_service.nodes.wiring.kernels`: it takes an order a
line, and answers each with a line when the disk has the machine code.
"""

import logging
import subprocess
import sys
from contextlib import suppress
from threading import Lock
from time import monotonic

from ...limited_process import ProcessLimits, limited_command
from ...models.kernel_cache import fill, make_elsewhere

log = logging.getLogger(__name__)
LIMITS = ProcessLimits(memory_mb=4000.0, cpu_s=900.0, nice=0)
REST_S = 10.0
"""Time after the last order for which the process waits for another."""
_COMMAND = (sys.executable, "-m", "edge_service.nodes.wiring.kernels")
_DONE = b"done\n"


class CompilingProcess:
    """A process that compiles; it begins with an order and ends when there are none."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._used_s = 0.0

    def fill(self, order: bytes) -> bool:
        """Have machine code put on the disk; tells whether it is there. Waits, from any thread."""
        with self._lock:
            self._used_s = monotonic()
            try:
                filled = self._ask(order)
            except OSError:
                filled = False
            if not filled:
                log.warning("compiling numeric code in this process: the separate process failed")
                self._end()
            self._used_s = monotonic()
            return filled

    def rest(self) -> None:
        """End the process if it has had nothing to do for a while; never waits."""
        if self._process is not None and self._lock.acquire(blocking=False):
            try:
                if monotonic() - self._used_s > REST_S:
                    self._end()
            finally:
                self._lock.release()

    def _ask(self, order: bytes) -> bool:
        if self._process is None or self._process.poll() is not None:
            log.info("compiling numeric code; this happens once for each version of the service")
            self._process = _started()
        orders, answers = self._process.stdin, self._process.stdout
        assert orders is not None and answers is not None
        orders.write(order.hex().encode() + b"\n")
        return answers.readline() == _DONE

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            with suppress(OSError), self._process:
                self._process = None


def _started() -> "subprocess.Popen[bytes]":
    """The process; it dies with the thread that starts it, for which the next order makes up."""
    return subprocess.Popen(
        limited_command(_COMMAND, LIMITS, dies_with_caller=True),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        start_new_session=True,
    )


COMPILER = CompilingProcess()


def compile_in_another_process() -> None:
    """Have what this process lacks of machine code compiled by another from now on."""
    make_elsewhere(COMPILER.fill)


def main() -> None:
    """Fill orders until nobody has any more."""
    for line in sys.stdin.buffer:
        fill(bytes.fromhex(line.decode()))
        sys.stdout.buffer.write(_DONE)
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
