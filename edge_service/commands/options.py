"""Options and arguments that several commands share, and the error for bad input."""

from pathlib import Path

import click

from ..config import DEFAULT_CONFIG, DEFAULT_MACHINE, EdgeConfig, load_config

CONFIG = click.argument("config", type=click.Path(path_type=Path), required=False)
MACHINE = click.option(
    "--machine",
    type=click.Path(path_type=Path),
    default=DEFAULT_MACHINE,
    show_default="the bench of the seed, deploy/machine.toml",
    help="Machine file: the baseline model.",
)
PORT = click.option("--port", type=click.IntRange(0, 65535), help="HTTP port; 0 takes a free one.")
BUS = click.option("--bus", "endpoint", help="Endpoint of the bus, e.g. tcp/127.0.0.1:7447.")


class InputError(Exception):
    """Bad input, told in one line."""


def configured(config: Path | None, port: int | None, endpoint: str | None) -> EdgeConfig:
    settings = load_config(config or DEFAULT_CONFIG)
    if port is not None:
        settings = settings.model_copy(
            update={"http": settings.http.model_copy(update={"port": port})}
        )
    if endpoint is not None:
        settings = settings.model_copy(
            update={"bus": settings.bus.model_copy(update={"endpoint": endpoint})}
        )
    return settings
