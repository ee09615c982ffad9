"""Tables of the configuration that may be left out, and what all tables have in common."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, model_validator

from .messages.keys import Column


class Table(BaseModel):
    """Unknown keys are refused. The file of a secret `x` may be named by a key `x_file`."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, hide_input_in_errors=True
    )


class VibrationConfig(Table):
    """`[vibration]`: reduction of sensors faster than the drive."""

    # name -> lower and upper frequency; rms of the signal by band
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

    # that systemd gives the service unless stated; without either all is in memory
    folder: Path | None = None
    # of the disk for all axes; recordings may take half of it
    budget_mb: float = Field(2000.0, ge=10.0)


class AlarmsConfig(Table):
    """`[alarms]`: what calls a person; percent of the fresh screw's preload."""

    warning_percent: float = Field(60.0, gt=0.0, le=100.0)
    fault_percent: float = Field(30.0, gt=0.0, le=100.0)
    rate_percent_per_1000_h: float = Field(20.0, gt=0.0)  # loss that is too fast
    sudden_drop_percent: float = Field(15.0, gt=0.0, le=100.0)  # loss within 10 s
    data_lost_after_s: float = Field(5.0, ge=0.0, le=3600.0)

    @model_validator(mode="after")
    def _ordered(self) -> "AlarmsConfig":
        if self.fault_percent >= self.warning_percent:
            raise ValueError("fault_percent must lie below warning_percent")
        return self
