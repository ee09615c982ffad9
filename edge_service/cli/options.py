"""Options that several commands share: of answers, of many recordings; the error of bad input."""

import json
import sys
from collections.abc import Callable, Iterable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..command_answer import Answer
from ..exit_status import DONE
from .terminal import pause_progress, progress

if TYPE_CHECKING:
    from ..config import EdgeConfig

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
FLAG = "--json"
PATH = click.Path(path_type=Path)
_ALONE = {"baseline", "pictures", "state"}
"""Options that mean one recording."""
ABOVE_0 = click.FloatRange(0.0, 1e9, min_open=True)
POSITIVE = click.FloatRange(min=0.0, min_open=True)
CONFIG = click.argument("config", type=PATH, required=False)
TRACE = click.argument("trace", type=PATH)
TRACES = click.argument("traces", nargs=-1, required=True, type=PATH)


def _test_bench() -> Path:
    """Machine file where none is named."""
    from ..config import DEFAULT_MACHINE

    return DEFAULT_MACHINE


MACHINE = click.option(
    "--machine",
    type=PATH,
    default=_test_bench,
    show_default="the thesis' test bench, deploy/machine.toml",
    help="Machine file with the baseline model of the axis.",
)
AXIS_NUMBER = click.option(
    "--axis-number",
    type=click.IntRange(1),
    show_default="the machine file's, or the only one there",
    help="The controller's number of the axis, for recordings of several axes.",
)
PORT = click.option(
    "--port", type=click.IntRange(0, 65535), help="HTTP port to serve on; 0 takes a free one."
)
BUS = click.option("--bus", "endpoint", help="Endpoint of the bus to use, e.g. tcp/127.0.0.1:7447.")

LEAD = click.option("--lead", type=POSITIVE, help="Travel per revolution of the motor, mm.")
LOAD_RATING = click.option(
    "--load-rating", type=POSITIVE, help="Dynamic load rating of the screw, N."
)
PRELOAD = click.option("--preload", type=POSITIVE, help="Preload of the fresh screw, N.")
PRELOAD_DRAG = click.option(
    "--preload-drag", type=POSITIVE, help="Drag torque of the fresh screw alone, N m."
)


def out_option(text: str, *, required: bool = True) -> Decorator:
    """Option `--out`: the file or folder that a command writes."""
    return click.option("--out", type=PATH, required=required, help=text)


def service_config_option(text: str) -> Decorator:
    """Option `--config`: the configuration of the service, for commands that work beside it."""
    return click.option("--config", type=PATH, help=text)


OUT_FOLDER = out_option("Folder to write the results to.")


def answering(command: Callable[..., Answer | Iterable[Answer]]) -> Callable[..., int]:
    """Print what a command returns, as words or with `--json` as a document; its exit status.

    A command with several answers yields them; each document is then one line.
    """

    @click.option(FLAG, "as_json", is_flag=True, help="Print the answer as JSON.")
    @wraps(command)
    def told(*arguments: Any, as_json: bool, **named: Any) -> int:
        answers = command(*arguments, **named)
        status = DONE
        for answer in [answers] if isinstance(answers, Answer) else answers:
            if said := answer.as_json() if as_json else answer.words:
                pause_progress()
                click.echo(said)
                sys.stdout.flush()
            status = max(status, answer.status)
        return status

    return told


def error_document(line: str, status: int) -> str:
    """A mistake as the document that stands in place of the answer."""
    return json.dumps({"error": {"detail": line, "exit_status": status}})


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


def configured(
    config: Path | None, port: int | None = None, endpoint: str | None = None
) -> "EdgeConfig":
    """Configuration in a file, or the default one; port and endpoint take precedence over its own.

    Raises ConfigError like `load_config`.
    """
    from ..config import DEFAULT_CONFIG, load_config

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


def batch_options(command: Callable[..., Answer]) -> Callable[..., Answer]:
    """Add `--each`, `--cluster` and `--workers`: every argument is a case of its own then."""

    @click.option(
        "--each",
        is_flag=True,
        help="Treat every argument as a case of its own, a folder as one session; "
        "--out is a folder with one folder a case and table.parquet.",
    )
    @click.option(
        "--cluster",
        metavar="ADDRESS",
        help="Spread --each over a Dask cluster: local, tcp://HOST:PORT or tls://HOST:PORT.",
    )
    @click.option(
        "--workers",
        type=click.IntRange(1),
        show_default="one per core",
        help="Number of processes of --cluster local.",
    )
    @wraps(command)
    def told(each: bool, cluster: str | None, workers: int | None, **named: Any) -> Answer:
        if workers is not None and cluster != "local":
            raise InputError("--workers: goes with --cluster local")
        if not each and cluster is None:
            return command(**named)
        return _batch(command.__name__, named, cluster, workers)

    return told


def _batch(name: str, named: dict[str, Any], cluster: str | None, workers: int | None) -> Answer:
    from ..offline.batch.batch import run_batch
    from ..offline.batch.work import Task

    for option in _ALONE & named.keys():
        if named.pop(option) is not None:
            raise InputError(f"--{option}: goes with one recording, not with --each or --cluster")
    traces: tuple[Path, ...] = named.pop("traces")
    out: Path = named.pop("out")
    task = Task(name, **_absolute(named))
    return run_batch(task, traces, out, cluster, workers, progress)


def _absolute(named: dict[str, Any]) -> dict[str, Any]:
    """Options whose files are found from anywhere: a worker has a working folder of its own."""
    return {name: _resolved(value) for name, value in named.items()}


def _resolved(value: Any) -> Any:
    if isinstance(value, Path):
        return value.resolve()
    return tuple(map(_resolved, value)) if isinstance(value, tuple) else value
