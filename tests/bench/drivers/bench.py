"""Load that the drivers take, beside the least that a client could."""

import os
import platform
import socket
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..table import PipelineBench
from .modbus import REGISTERS, fleet_figures, poll_figures
from .opcua import opcua_figures


@dataclass(frozen=True, slots=True)
class DriversBenchSettings:
    """Measuring times of the drivers' bench.

    Attributes:
        quick: short windows, and a device that hangs for 5 s instead of 60 s.
    """

    quick: bool = False

    @property
    def window_s(self) -> float:
        """Length of a measurement, s."""
        return 2.0 if self.quick else 15.0

    @property
    def hang_s(self) -> float:
        """For how long one device hangs, s."""
        return 5.0 if self.quick else 60.0


def run_drivers_bench(
    settings: DriversBenchSettings, progress: Callable[[str], None] = lambda _line: None
) -> PipelineBench:
    """Measure Modbus polls and a fleet of devices, and OPC UA notifications.

    Args:
        progress: called with a line before each part.

    Raises:
        PipelineBenchError: a process failed; one line.
    """
    progress("Modbus: one device, flat out")
    figures = poll_figures(settings.window_s)
    progress(f"Modbus: 32 devices, one of which hangs for {settings.hang_s:g} s")
    figures += fleet_figures(settings.window_s, settings.hang_s)
    progress("OPC UA: notifications")
    with tempfile.TemporaryDirectory(prefix="edge-service-bench-") as name:
        folder = Path(name)
        figures += opcua_figures(folder, folder / "kernels", _free_port(), settings.window_s)
    notes = (
        f"Python {platform.python_version()}, {os.cpu_count()} cores; the devices run on the same "
        "machine, and other work on it slows the figures.",
        f"A poll reads {REGISTERS} registers in one request over the loopback interface. The bare "
        "client blocks, checks nothing and does nothing else.",
    )
    return PipelineBench(tuple(figures), notes)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
