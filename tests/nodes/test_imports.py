"""Libraries that a service has loaded once it answers: none that it may never need."""

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
        "from edge_service import config; from edge_service.nodes.stages import warm_up;"
        "file = config.DEFAULT_MACHINE.with_name('commissioned.toml');"
        "warm_up(config.EstimatorConfig(), [config.load_machine(file)]);"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    assert printed(sys.executable, "-c", code).strip() == "[]"
