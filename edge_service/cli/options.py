"""Options that several commands share: of answers, of many recordings; the error of bad input."""

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial, wraps
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
Batch = Callable[[partial[Answer], Sequence[Path], Path], Answer]
POSITIVE = click.FloatRange(min=0.0, min_open=True)
CONFIG = click.argument("config", type=PATH, required=False)
TRACE = click.argument("trace", type=PATH)
TRACES = click.argument("traces", nargs=-1, required=True, type=PATH, metavar="TRACE...")


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
    "--port", type=click.IntRange(0, 65535), help="Port to serve on; 0: a free one."
)
BUS = click.option("--bus", "endpoint", help="Endpoint of the bus to use, e.g. tcp/127.0.0.1:7447.")
SCREW = click.option("--screw", metavar="TEXT", help='Data sheet: "20x10 C18200 P900" (mm, N, N).')
LEAD = click.option("--lead", type=POSITIVE, help="Travel per revolution of the motor, mm.")
SET = click.option(
    "--set",
    "keys",
    multiple=True,
    metavar="KEY=VALUE",
    help="Key of the machine file, e.g. table_mass_kg=80 or lead_m=10mm; may be repeated.",
)
SEED = click.option("--seed", type=click.IntRange(0), help="Seed of what is left to chance.")
FRESH = click.option("--force", is_flag=True, help="Overwrite what is there.")
EFFECTS = click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME[:KEY=VALUE,...]",
    help="Effect of the library; may be repeated.",
)


def out_option(text: str, *, required: bool = True) -> Decorator:
    """Option `--out`: the file or folder that a command writes."""
    return click.option("--out", type=PATH, required=required, help=text)


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
        http = settings.http.model_copy(update={"port": port})
        settings = settings.model_copy(update={"http": http})
    if endpoint is not None:
        bus = settings.bus.model_copy(update={"endpoint": endpoint})
        settings = settings.model_copy(update={"bus": bus})
    return settings


def batch_options(*written: str, implied: bool = False) -> Decorator:
    """Add options of a command over many recordings, in whose place it is given `batch`.

    That is None, or a function of work, recordings and folder, see `run_batch`.

    Args:
        written: files of the command in the folder of a case.
        implied: several recordings are cases of their own, there is no --each.
    """

    def decorate(command: Callable[..., Answer]) -> Callable[..., Answer]:
        @click.option(
            "--jobs", type=click.IntRange(1, 1024), help="Number of processes.  [default: 1]"
        )
        @click.option("--cluster", metavar="ADDRESS", help="Dask scheduler, tls://HOST:PORT.")
        @click.option("--insecure", is_flag=True, help="Allow a cluster on tcp://HOST:PORT.")
        @wraps(command)
        def told(jobs: int | None, cluster: str | None, insecure: bool, **named: Any) -> Answer:
            def batch(work: partial[Answer], traces: Sequence[Path], out: Path) -> Answer:
                from ..offline.batch import run_batch

                named = {name: _resolved(value) for name, value in work.keywords.items()}
                work = partial(work.func, *map(_resolved, work.args), **named)
                where = jobs or 1, cluster, insecure
                return run_batch(command.__name__, work, written, traces, out, *where, progress)

            each = len(named["traces"]) > 1 if implied else named.pop("each")
            return command(**named, batch=batch if each or jobs or cluster else None)

        if implied:
            return told
        return click.option(
            "--each",
            is_flag=True,
            help="Treat every TRACE as a case of its own, a folder as one session; "
            "--out gets one folder a case and table.parquet.",
        )(told)

    return decorate


def _resolved(value: Any) -> Any:
    """Value of an option; files are found from anywhere, a worker has a folder of its own."""
    if isinstance(value, Path):
        return value.resolve()
    return tuple(map(_resolved, value)) if isinstance(value, tuple) else value
