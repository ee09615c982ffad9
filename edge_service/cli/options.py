"""Commands made of functions: parameters say by annotation how they are given."""

import os
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin

import click

from .. import DEFAULTS
from ..command_answer import LISTENER, Answer
from ..exit_status import DONE, BadInputError
from .terminal import pause_progress, progress

if TYPE_CHECKING:
    from ..config import EdgeConfig

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
Batch = Callable[[partial[Answer], Sequence[Path], Path], Answer]
FLAG = "--json"
PATH = click.Path(path_type=Path)
POSITIVE = click.FloatRange(min=0.0, min_open=True)


@dataclass(frozen=True, slots=True)
class Option:
    """Option whose value goes to the parameter that it annotates.

    A parameter without one is an argument; a text states how that is shown.
    """

    words: str  # its help
    name: str = ""  # `--` and the parameter's name unless given
    # of the value, unless the type of the parameter says enough
    kind: click.ParamType[Any] | None = None
    metavar: str | None = None
    default: Any = None  # that the words tell


def command(
    example: str,
    name: str | None = None,
    *,
    answers: bool = True,
    hidden: bool = False,
    cls: type[click.Command] = click.Command,
) -> Callable[[Callable[..., Any]], click.Command]:
    """Command of a function, whose parameters say what is given to it."""

    def decorate(function: Callable[..., Any]) -> click.Command:
        made = _answering(function) if answers else function
        for parameter in reversed([*signature(function).parameters.values()]):
            if parameter.name != "batch":
                made = _given(parameter)(made)
        epilog = f"Example: edge-service {example}"
        return click.command(name, cls=cls, epilog=epilog, hidden=hidden)(made)

    return decorate


def _given(parameter: Parameter) -> Decorator:
    """Option or argument of a parameter; what may be None, a flag or several may be left out."""
    hint, said = parameter.annotation, None
    if get_origin(hint) is Annotated:
        hint, said = get_args(hint)
    inner, name = get_args(hint), parameter.name
    kind = inner[0] if inner and get_origin(hint) is not Literal else hint
    settings: dict[str, Any] = {"type": PATH if kind is Path else kind}
    if get_origin(kind) is Literal:
        settings["type"] = click.Choice(get_args(kind))
    is_needed = not (type(None) in inner or kind is bool)
    if parameter.default is not Parameter.empty:
        is_needed = False
        settings["default"] = parameter.default
    is_several = get_origin(hint) is tuple
    if not isinstance(said, Option):
        metavar = said or (name.upper() if is_needed else f"[{name.upper()}]")
        settings |= {"required": is_needed, "metavar": metavar, "nargs": -1 if is_several else 1}
        return click.argument(name, **settings)
    if kind is bool:
        settings = {"is_flag": True}
    settings["show_default"] = settings.get("default") is not None
    told = {"type": said.kind, "default": said.default}
    settings |= {key: each for key, each in told.items() if each is not None}
    settings |= {"required": is_needed and not is_several and said.default is None}
    settings |= {"multiple": is_several, "metavar": said.metavar, "help": said.words}
    return click.option(said.name or f"--{name.replace('_', '-')}", name, **settings)


def _answering(function: Callable[..., Answer | Iterable[Answer]]) -> Callable[..., int]:
    """Print what a command returns, as words or as a document; returns its exit status."""

    @click.option(FLAG, "as_json", is_flag=True, help="Print the answer as JSON.")
    @wraps(function)
    def told(*, as_json: bool, **named: Any) -> int:
        named = {key: _checked(key, each) for key, each in named.items()}
        LISTENER.set(progress)
        progress("loading")  # what the command imports may take seconds
        answers, status = function(**named), DONE
        for answer in [answers] if isinstance(answers, Answer) else answers:
            if said := answer.as_json() if as_json else answer.words:
                pause_progress()
                click.echo(said)
                sys.stdout.flush()
            status = max(status, answer.status)
        return status

    return told


def _checked(key: str, given: Any) -> Any:
    """Value that was given, a file that was named twice once. Raises BadInputError."""
    if isinstance(given, float) and not abs(given) < float("inf"):
        raise BadInputError(f"--{key.replace('_', '-')}: {given}, expected a finite number")
    for each in given if isinstance(given, tuple) else (given,):
        if isinstance(each, Path) and each.exists() and not (each.is_file() or each.is_dir()):
            raise BadInputError(f"{each}: a device; expected a file")
    are_files = isinstance(given, tuple) and given and isinstance(given[0], Path)
    return tuple({os.path.realpath(each): each for each in given}.values()) if are_files else given


Traces = Annotated[tuple[Path, ...], "TRACE..."]
MachineFile = Annotated[
    Path,
    Option(
        "Machine file with the baseline model of the axis.  "
        "[default: the thesis' test bench, deploy/machine.toml]",
        "--machine",
        default=DEFAULTS / "machine.toml",
    ),
]
AxisNumber = Annotated[
    int | None,
    Option(
        "The controller's number of the axis, for recordings of several axes.  "
        "[default: that of a machine file, or the only one there]",
        kind=click.IntRange(1),
    ),
]
Port = Annotated[int | None, Option("Port to serve; 0: a free one.", kind=click.IntRange(0, 65535))]
Endpoint = Annotated[str | None, Option("Endpoint of the bus, e.g. tcp/127.0.0.1:7447.", "--bus")]
Screw = Annotated[str | None, Option('Data sheet: "20x10 C18200 P900" (mm, N, N).')]
Lead = Annotated[float | None, Option("Travel per revolution of the motor, mm.", kind=POSITIVE)]
Keys = Annotated[
    tuple[str, ...],
    Option(
        "Key of the machine file, e.g. table_mass_kg=80 or lead_m=10mm; may be repeated.",
        "--set",
        metavar="KEY=VALUE",
    ),
]
Seed = Annotated[int | None, Option("Seed of what is left to chance.", kind=click.IntRange(0))]
Effects = Annotated[
    tuple[str, ...],
    Option("Effect of the library; may be repeated.", "--effect", metavar="NAME[:KEY=VALUE,...]"),
]
Without = Annotated[
    tuple[str, ...], Option("Effect that the library is to lack; may be repeated.", metavar="NAME")
]
OutFolder = Annotated[Path, Option("Folder to write the results to.")]


class Greedy(click.Command):
    """Command whose options for several files take all arguments up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat such an option before each of its files, as click has it."""
        options = [each for each in self.params if isinstance(each, click.Option) and each.multiple]
        many = {name for each in options if each.type is PATH for name in each.opts}
        spread: list[str] = []
        current = ""
        for arg in args:
            if arg.startswith("-"):
                current = arg if arg in many else ""
                spread += [] if current else [arg]
            else:
                spread += [current, arg] if current else [arg]
        return super().parse_args(ctx, spread)


def configured(
    config: Path | None, port: int | None = None, endpoint: str | None = None
) -> "EdgeConfig":
    """Configuration in a file, or the default one; port and endpoint take precedence over its own.

    Raises ConfigError like `load_config`.
    """
    from ..config import DEFAULT_CONFIG, load_config

    settings = load_config(config or DEFAULT_CONFIG)
    for name, key, value in (("http", "port", port), ("bus", "endpoint", endpoint)):
        if value is not None:
            table = getattr(settings, name).model_copy(update={key: value})
            settings = settings.model_copy(update={name: table})
    return settings


def batch_options(*written: str, implied: bool = False) -> Decorator:
    """Add options over many recordings, for which a command gets `batch`, see `run_batch`, or None.

    Args:
        written: files of the command in the folder of a case.
        implied: several recordings are cases of their own, there is no --each.
    """
    each_words = (
        "Treat every TRACE as a case of its own, a folder as one session; "
        "--out gets one folder a case and table.parquet."
    )

    def decorate(function: Callable[..., Answer]) -> Callable[..., Answer]:
        @click.option("--jobs", type=click.IntRange(1, 1024), help="Processes.  [default: 1]")
        @click.option("--cluster", metavar="ADDRESS", help="Dask scheduler, tls://HOST:PORT.")
        @click.option("--insecure", is_flag=True, help="Allow a cluster on tcp://HOST:PORT.")
        @wraps(function)
        def told(jobs: int | None, cluster: str | None, insecure: bool, **named: Any) -> Answer:
            def batch(work: partial[Answer], traces: Sequence[Path], out: Path) -> Answer:
                from ..offline.batch import run_batch

                named = {name: _resolved(value) for name, value in work.keywords.items()}
                work = partial(work.func, *map(_resolved, work.args), **named)
                where = jobs or 1, cluster, insecure
                return run_batch(function.__name__, work, written, traces, out, *where)

            each = len(named["traces"]) > 1 if implied else named.pop("each")
            return function(**named, batch=batch if each or jobs or cluster else None)

        return told if implied else click.option("--each", is_flag=True, help=each_words)(told)

    return decorate


def _resolved(value: Any) -> Any:
    """Value of an option; files are found from anywhere, a worker has a folder of its own."""
    if isinstance(value, Path):
        return value.resolve()
    return tuple(map(_resolved, value)) if isinstance(value, tuple) else value
