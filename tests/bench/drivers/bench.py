"""Load that the drivers take, beside the least that a client could."""

import os
import platform
import tempfile
from pathlib import Path

from ...drivers.bench import free_port
from ..table import Progress, Table, figures_table
from .modbus import REGISTERS, fleet_figures, poll_figures
from .opcua import opcua_figures


def run_drivers_bench(quick: bool, progress: Progress) -> Table:
    """Measure Modbus polls and a fleet of devices, and OPC UA notifications. Raises BenchError.

    Args:
        quick: short windows, and a device that hangs for 5 s instead of 60 s.
        progress: called with a line before each part.
    """
    window_s, hang_s = (2.0, 5.0) if quick else (15.0, 60.0)
    progress("Modbus: one device, flat out")
    figures = poll_figures(window_s)
    progress(f"Modbus: 32 devices, one of which hangs for {hang_s:g} s")
    figures += fleet_figures(window_s, hang_s)
    progress("OPC UA: notifications")
    with tempfile.TemporaryDirectory(prefix="edge-service-bench-") as name:
        folder = Path(name)
        figures += opcua_figures(folder, folder / "kernels", free_port(), window_s)
    notes = (
        f"Python {platform.python_version()}, {os.cpu_count()} cores; the devices run on the same "
        "machine, and other work on it slows the figures.",
        f"A poll reads {REGISTERS} registers in one request over the loopback interface. The bare "
        "client blocks, checks nothing and does nothing else.",
    )
    return figures_table(figures, notes)
