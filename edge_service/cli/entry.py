"""The `edge-service` command: gathers the commands, turns mistakes into one line."""

import ctypes
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import entry_points
from types import ModuleType

import click

from .. import __version__
from ..exit_status import BAD_INPUT, DONE, INTERNAL_FAILURE, INTERRUPTED, BadInputError
from . import connect, examine, service, twin
from .options import FLAG


def _commands(module: ModuleType) -> list[click.Command]:
    there = (each for each in vars(module).values() if isinstance(each, click.Command))
    return [each for each in there if not each.hidden]


CHECKS = tuple(each.load() for each in entry_points(group="edge_service.commands"))
GROUPS: dict[str, list[click.Command]] = {
    "Run the service": _commands(service),
    "Connect a machine": _commands(connect),
    "Examine an axis": _commands(examine),
    "Study the twin": [twin.simulate, twin.model, *CHECKS, twin.reproduce, twin.bench],
}
GONE: dict[str, str] = {
    "rollout": "gone; copy configurations with Ansible (deploy/ansible/)",
    "plant": "gone; run zenohd with deploy/zenoh-router.json5, then edge-service fleet tcp/ROUTER",
    "certs": "gone; use your authority, or mkcert, and [http] certificate",
    "audit": "gone; GET /api/v1/log?kind=command",
    "send-test": "now doctor CONFIG --send-test",
    "mtconnect-devices": "gone; the output writes mtconnect-devices.xml into the state folder",
    "response": "now fingerprint",
    "--config": "gone; CONFIG is named without an option, estimators by --method",
    "doctor --seconds": "now doctor CONFIG --duration",
    "--workers": "now --jobs",
    "--load-rating": "now --screw",
    "adopt --preload": "now --screw",
    "init --preload": "now --screw",
    "--pictures": "pictures are in report.html",
    "restore --history": "gone; history goes where the configuration keeps it",
    "fleet --plant": "gone; edge-service fleet tcp/ROUTER",
    "fleet --services": "gone; name the addresses, their tokens in .netrc",
    "token add": "now token CONFIG --add NAME --role viewer|operator",
    "token list": "now token CONFIG",
    "token revoke": "now token CONFIG --revoke NAME",
    "node vibration": "gone; node downsample reduces fast sensors",
}
"""Command, `command --option`, `command word`, or `--option` of any command -> what to do."""


class _Grouped(click.Group):
    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        del ctx
        for title, commands in GROUPS.items():
            formatter.write(f"\n{title}:\n")
            for each in commands:
                formatter.write(f"  {each.name:<16}{summary(each)}\n")
        formatter.write("\n`edge-service help COMMAND` shows options and an example.\n")


def summary(command: click.Command) -> str:
    """First line of a command's help."""
    return (command.help or "").partition("\n")[0].removesuffix(".")


@click.group("edge-service", cls=_Grouped, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="edge-service")
def cli() -> None:
    """Ball-screw preload from the signals a feed drive already has."""


@cli.command("help", hidden=True, epilog="Example: edge-service help diagnose")
@click.argument("command", required=False)
def show_help(command: str | None) -> None:
    """Show the commands, or the options and an example of one."""
    cli.main([*filter(None, [command]), "--help"], prog_name="edge-service", standalone_mode=False)


@cli.command(hidden=True, epilog="Example: edge-service version")
def version() -> None:
    """Show the version."""
    click.echo(f"edge-service, version {__version__}")


for _command in (*(each for commands in GROUPS.values() for each in commands), examine.drift):
    cli.add_command(_command)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status: 0 done, 2 bad input, 3 bad data, 1 a failure."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    as_json = FLAG in given
    if hasattr(libc := ctypes.CDLL(None), "mallopt"):
        libc.mallopt(-8, 1)  # M_ARENA_MAX of glibc: threads share one heap, 20 MB less
    command, *rest = given or [""]
    options = [each.partition("=")[0] for each in rest if each.startswith("--")]
    keys = [command, " ".join(given[:2]), *(f"{command} {each}" for each in options), *options]
    if gone := next((key for key in keys if key in GONE), None):
        return _complain(f"{gone}: {GONE[gone]}", status=BAD_INPUT, as_json=as_json)
    try:
        status = cli.main(args=given, prog_name="edge-service", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        return BAD_INPUT
    except (KeyboardInterrupt, click.Abort):
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()  # the reader of our pipe has gone; nothing is left to say
        return INTERNAL_FAILURE
    except Exception as error:  # the outermost edge: no traceback reaches a user
        words, status = _explained(error)
        shown = getattr(error, "mistakes", ()) if given[:1] == ["check-config"] else ()
        more = getattr(error, "document", None) or {}
        return _complain(*(shown or (words,)), status=status, as_json=as_json, **more)
    return status if isinstance(status, int) else DONE


def _explained(error: Exception) -> tuple[str, int]:
    if isinstance(error, click.exceptions.NoSuchCommand):
        near = error.possibilities or []
        guess = f"did you mean {near[0]!r}?" if near else "`edge-service help` lists them"
        return f"no command {error.command_name!r}; {guess}", BAD_INPUT
    if isinstance(error, click.ClickException):
        return error.format_message(), BAD_INPUT
    if isinstance(error, BadInputError):
        return str(error), error.status
    if os.environ.get("EDGE_SERVICE_DEBUG"):
        raise error
    cause = error.__context__ if isinstance(error, RuntimeError) else error  # links in a circle
    if isinstance(cause, OSError) and cause.filename:
        return f"{cause.filename}: cannot be used ({cause.strerror})", BAD_INPUT
    words = f"internal failure: {type(error).__name__}: {error} (EDGE_SERVICE_DEBUG=1 shows where)"
    return words, INTERNAL_FAILURE


def _complain(*lines: str, status: int, as_json: bool, **more: object) -> int:
    lines = tuple(" ".join(line.split()) for line in lines)
    for line in lines:
        click.echo(f"edge-service: {line}", err=True)
    if as_json:
        error = {"detail": "\n".join(lines), "exit_status": status}
        click.echo(json.dumps(more | {"error": error}, default=asdict))
    return status
