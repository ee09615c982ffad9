"""Libraries that are loaded at the start: none that a small computer may never need."""

import subprocess
import sys

import pytest

HEAVY = (
    *("scipy.signal", "scipy.linalg", "scipy.stats", "scipy.special", "pyarrow", "matplotlib"),
    *("filterpy", "httpx", "rich", "pymodbus", "asyncua", "aiomqtt", "google.protobuf", "mcap"),
    *("jinja2", "tomlkit", "edge_service.diagnose", "edge_service.offline"),
    "edge_service.fingerprint",
)


@pytest.mark.slow
def test_the_nodes_load_no_library_before_it_is_needed() -> None:
    code = (
        "import sys; import edge_service.cli.entry, edge_service.nodes.service;"
        "from drivers.registry import load_driver; load_driver('simulated');"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_the_command_line_loads_no_arithmetic_before_it_is_needed() -> None:
    """Help and completion by the shell must answer at once."""
    code = "import sys; import edge_service.cli.entry; print('numpy' in sys.modules)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "False"
