import tomllib
from pathlib import Path

import pytest

from edge_service.models.machine import Machine
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import Plant

BENCH = Path(__file__).parents[2] / "deploy" / "machine.toml"


@pytest.fixture
def machine() -> Machine:
    """The thesis' test bench."""
    return Machine.model_validate(tomllib.loads(BENCH.read_text()))


@pytest.fixture
def plant(machine: Machine) -> Plant:
    return plant_of(machine)
