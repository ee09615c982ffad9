"""User configuration of an OPC UA server: endpoint, access, and variables."""

from pathlib import Path
from typing import Literal
from urllib.parse import urlparse

from pydantic import Field, SecretStr, field_validator, model_validator

from edge_service.messages.addresses import is_loopback

from ..base import DriverConfig
from ..signals import SignalConfig, check_channels
from .names import check_name

Policy = Literal["None", "Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"]


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
        security_policy: None leaves everything open to all on the network.
        security_mode: whether messages are encrypted or only signed.
        certificate, private_key: ours, PEM or DER; needed with a security policy.
        server_certificate: the server's, which is trusted and no other; needed with a policy.
        user, password: of the session; never sent unencrypted but to this host itself.
        password_file: that holds the password.
        application_uri: ours, as in our certificate.
        publishing_s, sampling_s: what is asked for; the server says what it gives.
        queue_size: values that the server keeps for us between two publications.
        timeout_s: for each answer.
        lost_after_s: without a word from the server for this long it is lost.
        stale_after_s: a heartbeat that rests for this long makes all values bad.
        signals: the variables.
    """

    url: str = "opc.tcp://127.0.0.1:4840"
    security_policy: Policy = "None"
    security_mode: Literal["Sign", "SignAndEncrypt"] = "SignAndEncrypt"
    certificate: Path | None = None
    private_key: Path | None = None
    server_certificate: Path | None = None
    user: str | None = None
    password: SecretStr | None = None
    password_file: Path | None = None
    application_uri: str = "urn:edge-service:client"
    publishing_s: float = Field(0.1, ge=0.001, le=60.0)
    sampling_s: float = Field(0.1, ge=0.0, le=60.0)
    queue_size: int = Field(20, ge=1, le=10_000)
    timeout_s: float = Field(2.0, gt=0.0, le=60.0)
    lost_after_s: float = Field(2.0, gt=0.0, le=60.0)
    stale_after_s: float = Field(1.0, gt=0.0, le=3600.0)
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
        secured = self.security_policy != "None"
        for key in ("certificate", "private_key", "server_certificate"):
            if secured and getattr(self, key) is None:
                raise ValueError(f"{key}: missing, security_policy {self.security_policy} needs it")
            if not secured and getattr(self, key) is not None:
                raise ValueError(f"{key}: is for a security_policy, and that is None")
        if self.password is not None and self.user is None:
            raise ValueError("user: missing, there is a password")
        if self.user is not None and not secured and not is_loopback(self.host):
            raise ValueError("user: needs a security_policy, or the password could be read")
        return self

    @model_validator(mode="after")
    def _check_channels(self) -> "OpcuaConfig":
        check_channels("signals", self.signals)
        return self

    @property
    def has_heartbeat(self) -> bool:
        """True if a variable tells old values from new ones."""
        return any(signal.heartbeat for signal in self.signals)

    @property
    def plain_password(self) -> str:
        """The password itself; "" without."""
        return "" if self.password is None else self.password.get_secret_value()

    @property
    def host(self) -> str:
        """Host name of the server."""
        return urlparse(self.url).hostname or ""
