"""The `edge-service` command: gathers the commands, turns mistakes into one line."""

import os
import sys
from collections.abc import Sequence

import click

from .. import __version__
from ..exit_status import BAD_DATA, BAD_INPUT, DONE, INTERNAL_FAILURE, INTERRUPTED
from .adopt import adopt
from .bench import bench
from .diagnosis import diagnose, drift, fingerprint, gap, reproduce
from .fleet import fleet
from .init import init
from .motion import motion
from .options import FLAG, InputError, error_document
from .preload import commission, estimate
from .recordings import convert, record, simulate
from .service import backup, check_config, node, replay, restore, run
from .sources import doctor, stub
from .tokens import token

GONE: dict[str, str] = {
    "restore --config": "now edge-service restore ARCHIVE CONFIG",
    "restore --history": "gone; history goes where the configuration keeps it",
    "audit": "gone; GET /api/v1/log?kind=command",
    "fleet --plant": "gone; edge-service fleet tcp/ROUTER",
    "fleet --timeout": "gone; 5 s",
    "fleet --services": "gone; name the addresses, their tokens in .netrc",
    "mtconnect-devices": "gone; the output writes mtconnect-devices.xml into the state folder",
    "plant": "gone; run zenohd with deploy/zenoh.json5, then edge-service fleet tcp/ROUTER",
    "certs": "gone; use your authority, or mkcert, and [http] certificate",
    "send-test": "now doctor --config CONFIG --send-test",
    "response": "now fingerprint",
    "fingerprint --pictures": "gone; pictures are in report.html",
    "rollout": "gone; copy configurations with Ansible (deploy/ansible/)",
    "token add": "now token CONFIG --add NAME --role viewer|operator",
    "token list": "now token CONFIG",
    "token revoke": "now token CONFIG --revoke NAME",
    "node vibration": "gone; node downsample reduces fast sensors",
    "reproduce --stage-h": "gone; put time_h,speed_rpm,drag_torque_nm into FILE",
    "reproduce --speed-rpm": "gone; put time_h,speed_rpm,drag_torque_nm into FILE",
    "reproduce --speed-step-rpm": "gone; put time_h,speed_rpm,drag_torque_nm into FILE",
    "reproduce --speed-step-h": "gone; put time_h,speed_rpm,drag_torque_nm into FILE",
    "--workers": "now --jobs",
}
"""Command, `command --option`, `command word`, or `--option` of any command -> what to do."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status: 0 done, 2 bad input, 3 bad data, 1 a failure."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    gone = _gone(given)
    if gone is not None:
        return _complain(f"{gone}: {GONE[gone]}", status=BAD_INPUT, as_json=FLAG in given)
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
        return _complain(*(shown or (words,)), status=status, as_json=FLAG in given)
    return status if isinstance(status, int) else DONE


def _gone(given: Sequence[str]) -> str | None:
    """First command, word or option of a call that is gone; None without one."""
    command, *rest = given or [""]
    options = [each.partition("=")[0] for each in rest if each.startswith("--")]
    keys = [command, " ".join(given[:2]), *(f"{command} {each}" for each in options), *options]
    return next((key for key in keys if key in GONE), None)


def _explained(error: Exception) -> tuple[str, int]:
    """A mistake or failure in words, and the exit status."""
    if isinstance(error, click.ClickException):
        return error.format_message(), BAD_INPUT
    if _is_bad_input(error):
        return str(error), BAD_INPUT
    from ..offline.diagnosis.sessions import BadDataError

    if isinstance(error, BadDataError):
        return str(error), BAD_DATA
    if os.environ.get("EDGE_SERVICE_DEBUG"):
        raise error
    kind = type(error).__name__
    words = f"internal failure: {kind}: {error} (EDGE_SERVICE_DEBUG=1 shows where)"
    return words, INTERNAL_FAILURE


def _is_bad_input(error: Exception) -> bool:
    """Tell whether a person can mend it; the common mistakes load no room to be known by."""
    from ..config import ConfigError

    if isinstance(error, (InputError, ConfigError)):
        return True
    from ..bus.session import BusUnavailableError
    from ..bus.settings import BusConfigurationError
    from ..fingerprint.result import FingerprintError
    from ..health.store.tokens import TokenError
    from ..http_api.serve import AddressError
    from ..models.motions.registry import MotionError
    from ..offline.backup import BackupError
    from ..offline.diagnosis.sessions import DiagnosisError
    from ..offline.simulate import SimulationError
    from ..recordings.columns import TraceError

    bus = (BusConfigurationError, BusUnavailableError, AddressError)
    access = (TokenError, BackupError)
    twin = (MotionError, SimulationError, FingerprintError, DiagnosisError)
    return isinstance(error, (TraceError, *access, *bus, *twin))


def _complain(*lines: str, status: int, as_json: bool) -> int:
    lines = tuple(" ".join(line.split()) for line in lines)
    for line in lines:
        click.echo(f"edge-service: {line}", err=True)
    if as_json:
        click.echo(error_document("\n".join(lines), status))
    return status


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="edge-service")
def cli() -> None:
    """Ball-screw preload from the signals a feed drive already has."""


for _command in (
    *(
        run,
        node,
        check_config,
        backup,
        restore,
        token,
        replay,
        doctor,
        stub,
        record,
        convert,
        simulate,
    ),
    *(
        init,
        adopt,
        commission,
        estimate,
        motion,
        fingerprint,
        gap,
        diagnose,
        drift,
        reproduce,
        fleet,
        bench,
    ),
):
    cli.add_command(_command)
