import pytest

from edge_service.models.machine import Machine
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import Plant


@pytest.fixture
def plant(machine: Machine) -> Plant:
    return plant_of(machine)
