"""Configuration of a fleet node: every key is documented, every mistake is one line."""

import re
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import load_fleet_node

from ...documents import ROOT
from ...test_house import keys_of

EXAMPLE = ROOT / "deploy" / "fleet-node.toml"
HTTP_ONLY = {"connections", "certificate", "private_key", "tokens_file", "allowed_hosts"}
"""Keys of `[http]` that the example of a service shows."""


def test_the_example_loads_and_shows_every_key() -> None:
    config = load_fleet_node(EXAMPLE)
    assert config.history.folder == EXAMPLE.parent / "fleet-1"
    text = EXAMPLE.read_text()
    for key in keys_of(type(config)) - HTTP_ONLY:
        assert re.search(rf"\b{key}\b", text), key


NODE = '[node]\nname = "one"\n'
PLANT = '[plant]\nendpoint = "tcp/127.0.0.1:7450"\n'


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (PLANT, "node: missing"),
        (NODE, "plant: missing"),
        ('[node]\nname = "a/b"\n' + PLANT, "node.name: 'a/b' is no key part"),
        (NODE + '[plant]\nendpoint = "udp/x"\n', "plant"),
        (NODE + '[plant]\nendpoint = "tcp/10.0.0.1:7450"\n', "plant"),
        (NODE + '[plant]\nendpoint = "tls/10.0.0.1:7450"\n', "plant"),
        (NODE + PLANT + '[http]\nhost = "0.0.0.0"\n', "'0.0.0.0' is not a loopback address"),
        (NODE + PLANT + "[history]\nbudget_mb = 0\n", "history.budget_mb"),
        (NODE + PLANT + "[histroy]\n", "did you mean 'history'"),
        (NODE + PLANT + "[node.more]\nx = 1\n", "node.more: unknown key"),
    ],
)
def test_a_mistake_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, complaint: str
) -> None:
    path = tmp_path / "node.toml"
    path.write_text(text)
    assert main(["plant", "node", str(path)]) == 2
    said = capsys.readouterr().err
    assert complaint in said
    assert said.count("\n") == 1


def test_a_router_that_cannot_be_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    for listen in ("nonsense", "tcp/10.0.0.1:7450", "tls/127.0.0.1:7450"):
        assert main(["plant", "router", "--listen", listen]) == 2
        assert capsys.readouterr().err.count("\n") == 1
