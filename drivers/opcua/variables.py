"""Settings of an OPC UA server: endpoint, access, variables with names and units."""

import math
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
_CODES = {
    "m": "MTR",
    "mm": "MMT",
    "um": "4H",
    "m/s": "MTS",
    "mm/s": "C16",
    "mm/min": "H81",
    "m/min": "2X",
    "rad": "C81",
    "deg": "DD",
    "rad/s": "2A",
    "deg/s": "E96",
    "rev/min": "RPM",
    "rev/s": "RPS",
    "N m": "NU",
    "mN m": "D83",
    "N": "NEW",
    "kN": "B47",
    "degC": "CEL",
}
"""Unit -> its common code in UNECE Recommendation 20."""
UNIT_OF_ID = {int.from_bytes(code.encode(), "big"): unit for unit, code in _CODES.items()}
"""Unit id (OPC 10000-8, 5.6.3): characters of the common code, first one highest -> unit."""


def split_node(name: str) -> tuple[str, str]:
    """URI of the namespace, empty for one by number, and the node id in namespace 1 or its own.

    Raises ValueError for what can be no node id.
    """
    uri, rest = "", name
    if name.startswith("nsu="):
        uri, _, rest = name.removeprefix("nsu=").partition(";")
        rest = f"ns=1;{rest}"
    try:
        ua.NodeId.from_string(rest)
    except (ValueError, UaError):
        expected = "expected ns=2;s=X.torque or nsu=URI;s=X.torque"
        raise ValueError(f"{name!r} is no node: {expected}") from None
    return uri, rest


def node_id(name: str, namespaces: list[str]) -> ua.NodeId:
    """`ns=2;s=X` or `nsu=URI;s=X` on a server. Raises ValueError."""
    uri, rest = split_node(name)
    found = ua.NodeId.from_string(rest)
    if not uri:
        return found
    if uri not in namespaces:
        raise ValueError(f"the server has no namespace {uri!r}")
    return ua.NodeId(found.Identifier, ua.Int16(namespaces.index(uri)))


class NodeConfig(SignalConfig):
    """One variable."""

    node: str = Field(min_length=1)  # its node id, `ns=2;s=X.torque` or `nsu=URI;s=X.torque`
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
    """Settings of the OPC UA driver."""

    url: str = "opc.tcp://127.0.0.1:4840"  # of the server's endpoint
    # policy; messages are signed and encrypted. None leaves everything open to all
    security: Security = "None"
    # certificate, private_key: ours, PEM or DER; needed with security
    certificate: Path | None = None
    private_key: Path | None = None
    # the server's, which is trusted and no other; needed with security
    server_certificate: Path | None = None
    # user, password: of the session; never sent unencrypted but to this host itself
    user: str | None = None
    password: SecretStr | None = None
    password_file: Path | None = None  # that holds the password
    # sampling and publishing that is asked for; the server says what it gives
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
