"""Libraries that are loaded at the start: none that a small computer may never need."""

import sys

import pytest

from tests.programs import printed

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
        "from drivers.base import load_driver; load_driver('simulated');"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    assert printed(sys.executable, "-c", code).strip() == "[]"
