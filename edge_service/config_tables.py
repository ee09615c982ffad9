"""Tables of the configuration that may be left out, and what all tables have in common."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, SecretStr, model_validator

from .messages.addresses import is_loopback
from .messages.names import Column


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


class VibrationConfig(Table):
    """`[vibration]`: reduction of sensors faster than the drive.

    Attributes:
        bands_hz: name -> lower and upper frequency; rms of the signal by band.
    """

    bands_hz: dict[Column, tuple[float, float]] = Field(
        {"low": (10.0, 1000.0), "high": (1000.0, 5000.0)}, min_length=1, max_length=8
    )

    @model_validator(mode="after")
    def _check(self) -> "VibrationConfig":
        for name, (low, high) in self.bands_hz.items():
            if not 0.0 <= low < high:
                raise ValueError(f"bands_hz.{name}: [{low:g}, {high:g}], expected low below high")
        return self


class StoreConfig(Table):
    """`[store]`: where history, events and the state of alarms, trends and estimates are kept."""

    folder: Path | None = None
    budget_mb: float = Field(2000.0, ge=10.0)


class AlarmsConfig(Table):
    """`[alarms]`: what calls a person; percent of the fresh screw's preload."""

    rate_percent_per_1000_h: float = Field(20.0, gt=0.0)
    sudden_drop_percent: float = Field(15.0, gt=0.0, le=100.0)
    sudden_drop_within_s: float = Field(10.0, gt=0.0, le=3600.0)
    model_nis: float = Field(6.0, gt=1.0)
    raise_delay_s: float = Field(0.0, ge=0.0, le=3600.0)
    clear_delay_s: float = Field(5.0, ge=0.0, le=3600.0)
    data_lost_after_s: float = Field(5.0, ge=0.0, le=3600.0)
