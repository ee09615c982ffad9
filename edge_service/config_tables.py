"""Tables of the configuration that may be left out, and what all tables have in common."""

import re
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, SecretStr, field_validator, model_validator

from .messages.addresses import is_http_url, is_loopback
from .messages.event import Severity
from .messages.signing_key import signing_key

SHORTEST_SECRET = 16


class Table(BaseModel):
    """Unknown keys are refused. The file of a secret `x` may be named by a key `x_file`."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, hide_input_in_errors=True
    )


class BrokerAccess(Table):
    """Address and login of an MQTT broker.

    Attributes:
        password_file: that holds the password.
        ca_certificate: of the authority that signed the broker's certificate; TLS with it.
        client_certificate, client_key: ours, for a broker that asks for them.
    """

    host: str = Field(min_length=1)
    port: int = Field(1883, ge=1, le=65535)
    user: str | None = None
    password: SecretStr | None = None
    password_file: Path | None = None
    ca_certificate: Path | None = None
    client_certificate: Path | None = None
    client_key: Path | None = None

    @model_validator(mode="after")
    def _check_access(self) -> "BrokerAccess":
        if self.password is not None and self.user is None:
            raise ValueError("user: missing, there is a password")
        if self.user is not None and self.ca_certificate is None and not is_loopback(self.host):
            raise ValueError("user: needs ca_certificate, or the password could be read")
        if (self.client_certificate is None) != (self.client_key is None):
            missing = "client_key" if self.client_key is None else "client_certificate"
            raise ValueError(f"{missing}: missing, the two go together")
        if self.client_certificate is not None and self.ca_certificate is None:
            raise ValueError("client_certificate: needs ca_certificate, there is no TLS without")
        return self

    @property
    def plain_password(self) -> str | None:
        """The password itself."""
        return None if self.password is None else self.password.get_secret_value()


class MqttConfig(BrokerAccess):
    """`[mqtt]`: where answers are sent besides; nothing is sent without it.

    Attributes:
        payload: `json` as on the bus, or `sparkplug`: Sparkplug B 3.0.
        prefix: of JSON; first part of topics, `{prefix}/{site}/{machine}/{axis}/{preload|...}`.
        home_assistant: whether each axis is described to Home Assistant, with JSON.
        discovery_prefix: where Home Assistant looks for descriptions.
        period_s: at most one preload estimate per axis in this time; health and events all go.
        buffer: file in which messages wait while the broker is away.
        buffer_messages, buffer_mb: how many of them, and how much; then the oldest go.
    """

    payload: Literal["json", "sparkplug"] = "json"
    prefix: str = "feeddrive"
    home_assistant: bool = False
    discovery_prefix: str = "homeassistant"
    period_s: float = Field(1.0, ge=0.0, le=3600.0)
    buffer: Path = Path("mqtt-buffer.sqlite")
    buffer_messages: int = Field(1_000_000, ge=1)
    buffer_mb: float = Field(1000.0, gt=0.0)

    @model_validator(mode="after")
    def _check(self) -> "MqttConfig":
        for name in ("prefix", "discovery_prefix"):
            prefix = getattr(self, name)
            if any(sign in prefix for sign in "+#$\0") or not prefix.strip("/"):
                raise ValueError(f"{name} {prefix!r}: expected a topic without +, # and $")
        if self.home_assistant and self.payload != "json":
            raise ValueError('home_assistant: needs payload = "json"')
        return self


class VibrationConfig(Table):
    """`[vibration]`: fast sensors reduced to features; without it their signals are dropped.

    Attributes:
        interval_s: one set of features per interval.
        bands_hz: name -> lower and upper frequency.
        orders: name -> order per revolution of the screw; balls slip by up to `slip` of it. Unless
            given the screw's own, and the ball passes where the machine file knows the balls.
        keep_folder: where the raw signal around an event is kept; it is dropped without.
        keep_before_s, keep_after_s: how much of it.
    """

    interval_s: float = Field(1.0, ge=0.05, le=60.0)
    bands_hz: dict[str, tuple[float, float]] = {"low": (10.0, 1000.0), "high": (1000.0, 5000.0)}
    orders: dict[str, float] | None = None
    slip: float = Field(0.02, ge=0.0, le=0.2)
    keep_folder: Path | None = None
    keep_before_s: float = Field(5.0, ge=0.0, le=600.0)
    keep_after_s: float = Field(5.0, ge=0.0, le=600.0)

    @model_validator(mode="after")
    def _check(self) -> "VibrationConfig":
        for name, (low, high) in self.bands_hz.items():
            if not 0.0 <= low < high:
                raise ValueError(f"bands_hz.{name}: [{low:g}, {high:g}], expected low below high")
        for name, order in (self.orders or {}).items():
            if not order > 0.0:
                raise ValueError(f"orders.{name}: {order:g}, expected more than 0")
        return self


class StoreConfig(Table):
    """`[store]`: where history, events and the state of alarms, trends and estimates are kept."""

    folder: Path | None = None
    budget_mb: float = Field(2000.0, ge=10.0)


class JobsConfig(Table):
    """`[jobs]`: what one fingerprint or diagnosis may take, and all recordings together."""

    minutes: float = Field(60.0, gt=0.0, le=10_080.0)
    memory_mb: float = Field(4000.0, ge=500.0)
    recordings_mb: float = Field(5000.0, ge=1.0)


class AlarmsConfig(Table):
    """`[alarms]`: what calls a person; percent of the fresh screw's preload."""

    rate_percent_per_1000_h: float = Field(20.0, gt=0.0)
    sudden_drop_percent: float = Field(15.0, gt=0.0, le=100.0)
    sudden_drop_within_s: float = Field(10.0, gt=0.0, le=3600.0)
    model_nis: float = Field(6.0, gt=1.0)
    raise_delay_s: float = Field(0.0, ge=0.0, le=3600.0)
    clear_delay_s: float = Field(5.0, ge=0.0, le=3600.0)
    data_lost_after_s: float = Field(5.0, ge=0.0, le=3600.0)


class EventOutputConfig(Table):
    """Keys that outputs of events share.

    Attributes:
        kinds: of the events that are sent.
        give_up_h: time of pauses after which one becomes a dead letter whatever the receiver does.
        buffer: file in which events wait; unless given in the folder of the history.
        buffer_events, buffer_mb: how many of them, and how much; then the oldest go.
    """

    kinds: tuple[str, ...] = ("alarm_raised", "alarm_cleared", "condition_changed")
    give_up_h: float = Field(72.0, gt=0.0, le=8760.0)
    buffer: Path | None = None
    buffer_events: int = Field(100_000, ge=1)
    buffer_mb: float = Field(100.0, gt=0.0)


class WebhookConfig(EventOutputConfig):
    """`[webhook]`: where events are posted to; nothing is sent without a `url`.

    Attributes:
        url: of the receiver; secret, as it may hold a password or a token.
        secret: what is sent is signed with it; may be a `whsec_...` of Standard Webhooks.
        previous_secret: signs as well, until every receiver knows the new one.
        tries: refusals after which an event becomes a dead letter if the receiver takes the next.
    """

    url: SecretStr | None = None
    url_file: Path | None = None
    secret: SecretStr | None = None
    secret_file: Path | None = None
    previous_secret: SecretStr | None = None
    previous_secret_file: Path | None = None
    tries: int = Field(4, ge=1, le=1000)

    @field_validator("url")
    @classmethod
    def _http(cls, value: SecretStr | None) -> SecretStr | None:
        if value is not None and not is_http_url(value.get_secret_value()):
            raise ValueError("expected http://HOST[:PORT][/PATH] or https://...")
        return value

    @field_validator("secret", "previous_secret")
    @classmethod
    def _long(cls, value: SecretStr | None) -> SecretStr | None:
        if value is not None:
            signing_key(value.get_secret_value())
            if len(value.get_secret_value()) < SHORTEST_SECRET:
                raise ValueError(f"expected at least {SHORTEST_SECRET} characters")
        return value

    @model_validator(mode="after")
    def _signed(self) -> "WebhookConfig":
        if self.url is not None and self.secret is None:
            raise ValueError("url needs a secret_file: what is sent is signed with it")
        return self


_ATOM = r"[A-Za-z0-9!#$%&'*+/=?^_`{|}~-]+"
_ADDRESS = re.compile(rf"{_ATOM}(\.{_ATOM})*@[A-Za-z0-9-]+(\.[A-Za-z0-9-]+)*")
"""An address without quoted parts (RFC 5322, 3.4.1)."""
_PORTS = {"starttls": 587, "tls": 465, "plain": 25}


class EmailConfig(EventOutputConfig):
    """`[email]`: whom events are mailed to; nothing is sent without a `host`.

    Attributes:
        host, port: of the SMTP server; the usual port of its `security` unless stated.
        security: `starttls`, `tls` from the beginning, or `plain`: to loopback only, unless
            `allow_plain`.
        ca_certificate: of the authority that signed its certificate; those of the system without.
        sender, recipients: addresses.
        severities: of the events that are sent.
        language: of the letters.
        page_url: of the page, for links.
        gather_s: events of this time go in one letter.
        most_per_hour: letters in an hour; then events wait, and go together.
    """

    kinds: tuple[str, ...] = ("alarm_raised", "alarm_cleared")
    host: str | None = Field(None, min_length=1)
    port: int | None = Field(None, ge=1, le=65535)
    security: Literal["starttls", "tls", "plain"] = "starttls"
    allow_plain: bool = False
    ca_certificate: Path | None = None
    user: str | None = None
    password: SecretStr | None = None
    password_file: Path | None = None
    sender: str = ""
    recipients: tuple[str, ...] = ()
    severities: tuple[Severity, ...] = (Severity.WARNING, Severity.ERROR)
    language: Literal["en", "de"] = "en"
    page_url: str = ""
    gather_s: float = Field(30.0, ge=0.0, le=3600.0)
    most_per_hour: int = Field(12, ge=1, le=1000)

    @field_validator("sender", "recipients")
    @classmethod
    def _addresses(cls, value: str | tuple[str, ...]) -> str | tuple[str, ...]:
        for each in (value,) if isinstance(value, str) else value:
            if each and not _ADDRESS.fullmatch(each):
                raise ValueError(f"{each!r}: expected an address of the form name@example.org")
        return value

    @field_validator("page_url")
    @classmethod
    def _http(cls, value: str) -> str:
        if value and not is_http_url(value):
            raise ValueError("expected http://HOST[:PORT][/PATH] or https://...")
        return value

    @model_validator(mode="after")
    def _complete(self) -> "EmailConfig":
        if self.host is None:
            return self
        for name in ("sender", "recipients"):
            if not getattr(self, name):
                raise ValueError(f"{name}: missing; it is needed with a host")
        if (self.user is None) != (self.password is None):
            lone = "user" if self.user is None else "password_file"
            raise ValueError(f"{lone}: missing; user and password_file are needed together")
        if self.security == "plain" and not (self.allow_plain or is_loopback(self.host)):
            raise ValueError(
                "security: plain beyond loopback, where others may read, needs allow_plain"
            )
        return self

    @property
    def used_port(self) -> int:
        """The port as stated, or the usual one."""
        return self.port or _PORTS[self.security]
