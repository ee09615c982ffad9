"""Options and arguments that several commands share, and the error for bad input."""

from pathlib import Path

import click

from ..config import DEFAULT_CONFIG, DEFAULT_MACHINE, EdgeConfig, load_config

CONFIG = click.argument("config", type=click.Path(path_type=Path), required=False)
MACHINE = click.option(
    "--machine",
    type=click.Path(path_type=Path),
    default=DEFAULT_MACHINE,
    show_default="the thesis' test bench, deploy/machine.toml",
    help="Machine file with the baseline model of the axis.",
)
AXIS_NUMBER = click.option(
    "--axis-number",
    type=click.IntRange(1),
    show_default="the machine file's, or the only one there",
    help="The controller's number of the axis, in recordings that hold several.",
)
PORT = click.option(
    "--port", type=click.IntRange(0, 65535), help="HTTP port to serve on; 0 takes a free one."
)
BUS = click.option("--bus", "endpoint", help="Endpoint of the bus to use, e.g. tcp/127.0.0.1:7447.")


class Greedy(click.Command):
    """Command whose options for several files take all arguments up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat such an option before each of its files, as click has it."""
        many = {
            name
            for each in self.params
            if isinstance(each, click.Option) and each.multiple
            for name in each.opts
        }
        spread: list[str] = []
        option = ""
        for arg in args:
            if arg.startswith("-"):
                option = arg if arg in many else ""
                spread += [] if option else [arg]
            else:
                spread += [option, arg] if option else [arg]
        return super().parse_args(ctx, spread)


class InputError(Exception):
    """Bad input; the text is one line."""


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
