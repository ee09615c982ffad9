"""The machine files of the configured axes."""

from ..config import EdgeConfig, load_machine
from ..models.machine import Machine


def load_machines(config: EdgeConfig) -> dict[str, Machine]:
    """Machine of each axis, by the axis' name. Raises ConfigError."""
    return {axis.name: load_machine(axis.machine) for axis in config.axes}
