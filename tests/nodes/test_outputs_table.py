"""The table of outputs is the whole truth: configuration, nodes, rights and documents follow it."""

from pathlib import Path

import pytest

import edge_service.nodes
from edge_service.bus.access import PUTS, components_of
from edge_service.config import EdgeConfig
from edge_service.messages.components import COMPONENTS
from edge_service.messages.outputs import HTTP, OF_HTTP, OUTPUTS
from edge_service.nodes.outputs.registry import OPENERS
from edge_service.nodes.service import OPTIONAL

from ..documents import guide

FOLDER = Path(edge_service.nodes.__file__).parent


def test_every_output_of_events_can_be_opened() -> None:
    assert OPENERS.keys() == set(OF_HTTP)


@pytest.mark.parametrize("output", OUTPUTS.values(), ids=list(OUTPUTS))
def test_an_output_has_its_place_everywhere(output) -> None:
    assert output.name in EdgeConfig.model_fields
    assert output.name in COMPONENTS
    assert output.name in components_of(output.node)
    assert f"`[{output.name}]" in guide()
    assert output.node in PUTS
    if output.node != HTTP:
        assert PUTS[output.node] == ()
        assert output.node in OPTIONAL
        assert EdgeConfig.model_fields[output.name].default is None
        assert (FOLDER / f"{output.node}_node.py").exists()
