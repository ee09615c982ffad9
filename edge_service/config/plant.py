"""Configuration of a fleet node: one of the nodes that read a plant."""

from pathlib import Path

from pydantic import Field, field_validator, model_validator

from ..config_tables import Table
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


class PlantLinkTable(Table):
    """`[plant]`: a router of the plant.

    Attributes:
        endpoint: `tcp/host:port`, or `tls/host:port` with certificates.
        ca_certificate, client_certificate, client_key: for mutual TLS, in PEM.
        allow_plain: whether TCP may leave this machine.
    """

    endpoint: str
    ca_certificate: Path | None = None
    client_certificate: Path | None = None
    client_key: Path | None = None
    allow_plain: bool = False

    @model_validator(mode="after")
    def _together(self) -> "PlantLinkTable":
        files = ("ca_certificate", "client_certificate", "client_key")
        missing = [name for name in files if getattr(self, name) is None]
        if missing and len(missing) < len(files):
            raise ValueError(f"{missing[0]}: missing; {', '.join(files)} go together")
        return self


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
    plant: PlantLinkTable
    http: HttpConfig = HttpConfig()
    history: FleetHistoryTable = FleetHistoryTable()
