"""Settings of an OPC UA server: endpoint, access, variables with names and units."""

import math
import re
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
_URI = re.compile(r"\{([^}]*)\}")
_NSU = re.compile(r"^nsu=[^;]*;")


def is_path(name: str) -> bool:
    """Return whether a name is a path of browse names and not a node id."""
    return name.startswith("{") or "=" not in name.partition(";")[0]


def check_name(name: str) -> str:
    """Return a name that can be one whatever the server; raise ValueError if it cannot."""
    example = "expected ns=2;s=X.torque, nsu=URI;s=X.torque or {URI}Machines/{URI}Lathe"
    try:
        if is_path(name):
            browse_path(name, [*_URI.findall(name)])
        else:
            ua.NodeId.from_string(_NSU.sub("ns=1;", name))
    except (ValueError, UaError):
        raise ValueError(f"{name!r} is no node: {example}") from None
    return name


def browse_path(name: str, namespaces: list[str]) -> list[str]:
    """`{URI}Machines/Name` -> ["3:Machines", "0:Name"]; a URI may hold slashes.

    Raises:
        ValueError: a namespace that the server does not have, or a brace too few.
    """
    steps, rest = [], name
    while rest:
        index = 0
        if rest.startswith("{"):
            uri, closed, rest = rest[1:].partition("}")
            if not closed:
                raise ValueError("a { without its }")
            index = _namespace(uri, namespaces)
        step, _, rest = rest.partition("/")
        steps.append(f"{index}:{step}")
    return steps


def node_id(name: str, namespaces: list[str]) -> ua.NodeId:
    """`ns=2;s=X` or `nsu=URI;s=X`. Raises ValueError and the library's parsing error."""
    if name.startswith("nsu="):
        uri, _, rest = name.removeprefix("nsu=").partition(";")
        name = f"ns={_namespace(uri, namespaces)};{rest}"
    return ua.NodeId.from_string(name)


def _namespace(uri: str, namespaces: list[str]) -> int:
    if uri not in namespaces:
        raise ValueError(f"the server has no namespace {uri!r}")
    return namespaces.index(uri)


class NodeConfig(SignalConfig):
    """One variable.

    Attributes:
        node: its node id, `ns=2;s=X.torque` or `nsu=URI;s=X.torque`; or its path of browse names
            below Objects, `{URI}Machines/{URI}Lathe/Torque`, without {URI} in the namespace of OPC
            UA itself.
        heartbeat: no channel but a counter or clock: while it rests, values are old.
    """

    node: str = Field(min_length=1)
    heartbeat: bool = False

    @field_validator("node")
    @classmethod
    def _is_a_name(cls, value: str) -> str:
        return check_name(value)

    @model_validator(mode="after")
    def _one_role(self) -> "NodeConfig":
        if (self.channel is not None) == self.heartbeat:
            raise ValueError("expected exactly one of channel and heartbeat = true")
        return self


class OpcuaConfig(DriverConfig):
    """Settings of the OPC UA driver.

    Attributes:
        url: of the server's endpoint.
        security: policy; messages are signed and encrypted. None leaves everything open to all.
        certificate, private_key: ours, PEM or DER; needed with security.
        server_certificate: the server's, which is trusted and no other; needed with security.
        user, password: of the session; never sent unencrypted but to this host itself.
        password_file: that holds the password.
        sampling_s: sampling and publishing that is asked for; the server says what it gives.
        signals: the variables.
    """

    url: str = "opc.tcp://127.0.0.1:4840"
    security: Security = "None"
    certificate: Path | None = None
    private_key: Path | None = None
    server_certificate: Path | None = None
    user: str | None = None
    password: SecretStr | None = None
    password_file: Path | None = None
    sampling_s: float = Field(0.1, ge=0.001, le=60.0)
    signals: tuple[NodeConfig, ...] = Field(min_length=1)

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
