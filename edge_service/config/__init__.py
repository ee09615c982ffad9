"""The service's configuration and machine files: read, checked, every mistake told by its key."""

from ..config_tables import AlarmsConfig, StoreConfig, Table
from .loading import (
    DEFAULT_CONFIG,
    check_settings,
    load_config,
    load_machine,
    read_axis,
    read_config,
    state_folder,
)
from .mistakes import ConfigError, explain
from .service import (
    DEFAULT_MACHINE,
    AxisConfig,
    BusConfig,
    EdgeConfig,
    EstimatorConfig,
    HttpConfig,
    ServiceConfig,
)

__all__ = [
    "DEFAULT_CONFIG",
    "DEFAULT_MACHINE",
    "AlarmsConfig",
    "AxisConfig",
    "BusConfig",
    "ConfigError",
    "EdgeConfig",
    "EstimatorConfig",
    "HttpConfig",
    "ServiceConfig",
    "StoreConfig",
    "Table",
    "check_settings",
    "explain",
    "load_config",
    "load_machine",
    "read_axis",
    "read_config",
    "state_folder",
]
