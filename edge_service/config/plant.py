"""Configuration of a fleet node: one of the nodes that read a plant."""

from pathlib import Path

from pydantic import Field, field_validator

from ..config_tables import PlantAccess, Table
from ..messages.addresses import service_address
from ..messages.names import check_part
from .service import HttpConfig


class FleetNodeTable(Table):
    """`[node]`: who this node is among the fleet nodes of the plant.

    Attributes:
        name: unlike that of any other fleet node.
        page: address of its page for people, as the other nodes show it; empty without one.
    """

    name: str
    page: str = ""

    @field_validator("name")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)

    @field_validator("page")
    @classmethod
    def _http(cls, value: str) -> str:
        return service_address(value) if value else ""


class FleetHistoryTable(Table):
    """`[history]`: where a fleet node keeps the machines that it knows, and what their logs say.

    Attributes:
        folder: without one nothing outlives the process, and no log is fetched.
        budget_mb: size of the history; then its oldest goes.
    """

    folder: Path | None = None
    budget_mb: float = Field(2000.0, ge=1.0)


class FleetNodeConfig(Table):
    """The whole configuration file of a fleet node."""

    node: FleetNodeTable
    plant: PlantAccess
    http: HttpConfig = HttpConfig()
    history: FleetHistoryTable = FleetHistoryTable()
