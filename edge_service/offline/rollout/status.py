"""`edge-service rollout status`: program, configuration and bundle of a machine."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from ... import __version__
from ...command_answer import Answer
from ...config import load_config
from ...health.events.audit import last_of
from ...nodes.stores.diary_store import DIARY
from ..document import Document
from .contents import RolloutError
from .place import Place


class LastStart(Document):
    """Last start of the service, by its audit log; bundle null if it was none.

    Attributes:
        at: UTC, ISO 8601.
        configuration: digest of what it was started with.
    """

    at: str
    version: str
    configuration: str
    bundle: int | None


class RolloutStatus(Document):
    """Versions that a service runs if it is started now.

    Attributes:
        configuration: digest, as the page and the metrics tell it.
        bundle: number; null if none was rolled out, or files have been changed since.
        rolled_out: number of the bundle that was put in place last; null without one.
        made, made_by, signer: of that bundle; empty without one.
        changed_here: governed files that have been changed since.
        back_to: number of the bundle to go back to; null for none, or for what people had written.
        can_go_back: whether there is an earlier state.
        highest: greatest number that ever was in place; bundles up to it are refused.
        started: null if no audit log tells.
        needs_restart: whether the last start was with another version or configuration.
    """

    version: str
    site: str
    machine: str
    configuration: str
    bundle: int | None
    rolled_out: int | None
    made: str
    made_by: str
    signer: str
    changed_here: list[str]
    can_go_back: bool
    back_to: int | None
    highest: int
    started: LastStart | None
    needs_restart: bool


def status(config: Path) -> Answer:
    """Tell versions of program and configuration. Raises ConfigError, RolloutError."""
    settings = load_config(config)
    started = _last_start(settings.history.folder)
    runs = (started.version, started.configuration) if started else None
    place = Place(config)
    try:
        now = place.now
        before = place.applied(now.before) if now and now.before else None
        told = RolloutStatus(
            version=__version__,
            site=settings.service.site,
            machine=settings.service.machine,
            configuration=settings.identity.digest,
            bundle=settings.identity.bundle,
            rolled_out=now.number if now else None,
            made=now.made if now else "",
            made_by=now.made_by if now else "",
            signer=now.signer if now else "",
            changed_here=place.changed_here(),
            can_go_back=before is not None,
            back_to=before.number if before else None,
            highest=place.highest(),
            started=started,
            needs_restart=runs not in (None, (__version__, settings.identity.digest)),
        )
    except OSError as error:
        raise RolloutError(f"{error.filename or config}: {error.strerror}") from None
    return Answer("\n".join(_lines(told)), told)


def _last_start(history: Path | None) -> LastStart | None:
    if history is None or not (history / DIARY).is_file():
        return None
    try:
        entry = last_of(history / DIARY, "service_started")
    except ValueError as error:
        raise RolloutError(str(error)) from None
    told = entry.data if entry else {}
    if entry is None or "configuration_digest" not in told:  # by a version that did not tell
        return None
    bundle = told.get("bundle")
    return LastStart(
        at=datetime.fromtimestamp(entry.time_ns / 1e9, UTC).isoformat(timespec="seconds"),
        version=str(told.get("version", "")),
        configuration=str(told["configuration_digest"]),
        bundle=bundle if isinstance(bundle, int) else None,
    )


def _lines(told: RolloutStatus) -> Iterator[str]:
    yield f"{told.machine} of site {told.site}: edge-service {told.version}"
    if told.rolled_out is None:
        yield f"configuration {told.configuration}, of no bundle"
    else:
        yield (
            f"configuration {told.configuration}, bundle {told.rolled_out}, packed {told.made} "
            f"by edge-service {told.made_by}, signed by the key {told.signer}"
        )
    yield from (f"{name}: was changed here since" for name in told.changed_here)
    if told.started:
        began = told.started
        words = began.configuration if began.bundle is None else f"bundle {began.bundle}"
        yield f"last started {began.at} with edge-service {began.version} and {words}" + (
            ": restart it" if told.needs_restart else ""
        )
    if told.can_go_back:
        earlier = "the configuration from before" if told.back_to is None else told.back_to
        yield f"edge-service rollout back leads to {earlier}"
    if told.highest:
        yield f"bundles up to {told.highest} are refused"
