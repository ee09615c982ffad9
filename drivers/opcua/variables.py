"""Settings of an OPC UA server: endpoint, access, variables with names and units."""

import math
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Literal
from urllib.parse import urlparse

from asyncua import ua
from asyncua.ua.uaerrors import UaError
from pydantic import Field, SecretStr, field_validator, model_validator

from edge_service.messages.addresses import is_loopback

from ..base import DriverConfig
from ..signals import SignalConfig, check_channels

Security = Literal["None", "Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]
_CODES: dict[str, str] = tomllib.loads((files(__package__) / "codes.toml").read_text("utf-8"))
"""Unit -> its common code in UNECE Recommendation 20."""
UNIT_OF_ID = {int.from_bytes(code.encode(), "big"): unit for unit, code in _CODES.items()}
"""Unit id (OPC 10000-8, 5.6.3): characters of the common code, first one highest -> unit."""


def split_node(name: str) -> tuple[str, ua.NodeId]:
    """URI of the namespace, empty for one by number, and the node id. Raises ValueError."""
    try:
        found = ua.NodeId.from_string(name)
    except (ValueError, UaError):
        expected = "expected ns=2;s=X.torque or nsu=URI;s=X.torque"
        raise ValueError(f"{name!r} is no node: {expected}") from None
    return getattr(found, "NamespaceUri", None) or "", found


def node_id(name: str, namespaces: list[str]) -> ua.NodeId:
    """`ns=2;s=X` or `nsu=URI;s=X` on a server. Raises ValueError."""
    uri, found = split_node(name)
    if not uri:
        return found
    if uri not in namespaces:
        raise ValueError(f"the server has no namespace {uri!r}")
    return ua.NodeId(found.Identifier, ua.Int16(namespaces.index(uri)))


class NodeConfig(SignalConfig):
    """One variable."""

    node: str = Field(min_length=1)  # its node id, `ns=2;s=X.torque` or `nsu=URI;s=X.torque`
    index: int | None = Field(None, ge=0)  # of one element, from 0, where the value is an array
    heartbeat: bool = False  # no channel but a counter or clock: while it rests, values are old

    @field_validator("node")
    @classmethod
    def _is_a_node(cls, value: str) -> str:
        split_node(value)
        return value

    @model_validator(mode="after")
    def _one_role(self) -> "NodeConfig":
        if (self.channel is not None) == self.heartbeat:
            raise ValueError("expected exactly one of channel and heartbeat = true")
        return self


class OpcuaConfig(DriverConfig):
    """Settings of the OPC UA driver; `deploy/drivers/opcua.toml` tells of each."""

    url: str = "opc.tcp://127.0.0.1:4840"  # of the server's endpoint
    security: Security = "None"
    certificate: Path | None = None
    private_key: Path | None = None
    server_certificate: Path | None = None
    user: str | None = None
    password: SecretStr | None = None
    password_file: Path | None = None  # that holds the password
    sampling_s: float = Field(0.1, ge=0.001, le=60.0)
    signals: tuple[NodeConfig, ...] = Field(min_length=1)  # the variables

    @field_validator("url")
    @classmethod
    def _is_an_address(cls, value: str) -> str:
        try:
            parts = urlparse(value)
            right = parts.scheme == "opc.tcp" and bool(parts.hostname) and parts.port != 0
        except ValueError:
            right = False
        if not right:
            raise ValueError(f"{value!r}: expected opc.tcp://HOST:PORT[/PATH]")
        if parts.username is not None:
            raise ValueError("user and password have keys of their own")
        return value

    @model_validator(mode="after")
    def _check_security(self) -> "OpcuaConfig":
        secured = self.security != "None"
        for key in ("certificate", "private_key", "server_certificate"):
            if secured and getattr(self, key) is None:
                raise ValueError(f"{key}: missing, security {self.security} needs it")
            if not secured and getattr(self, key) is not None:
                raise ValueError(f"{key}: is for security, and that is None")
        if self.password is not None and self.user is None:
            raise ValueError("user: missing, there is a password")
        if self.user is not None and not secured and not is_loopback(self.host):
            raise ValueError("user: needs security, or the password could be read")
        check_channels("signals", self.signals)
        return self

    @property
    def stale_after_s(self) -> float:
        """A heartbeat that rests for this long makes all values bad; infinite without one."""
        has_heartbeat = any(signal.heartbeat for signal in self.signals)
        return max(1.0, 10.0 * self.sampling_s) if has_heartbeat else math.inf

    @property
    def plain_password(self) -> str:
        """The password itself; "" without."""
        return "" if self.password is None else self.password.get_secret_value()

    @property
    def host(self) -> str:
        """Host name of the server."""
        return urlparse(self.url).hostname or ""
