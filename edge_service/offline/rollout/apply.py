"""`edge-service rollout apply` and `back`: a bundle put in place whole, or not at all."""

import shutil
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ... import __version__
from ...clock import now_ns
from ...command_answer import Answer
from ...config.identity import Applied
from ..document import Document
from .bundle import Bundle, open_bundle
from .changes import ChangedFile, change_lines, changes
from .contents import BundledMachine, RolloutError, minor
from .place import Place, digest_of
from .trial import check_new

_SPARE_BYTES = 1_000_000
_NEVER = "0.0.0"


class RolledOut(Document):
    """Change of a configuration that was made, or with `dry_run` would be.

    Attributes:
        before: number of the bundle in place until now; null without one.
        now: number of the bundle in place from now on; null for what people had written.
        changed_here: governed files that people have changed since the last bundle.
        not_reachable: sources that do not answer now.
    """

    machine: str
    before: int | None
    now: int | None
    configuration: str
    changes: list[ChangedFile]
    changed_here: list[str]
    not_reachable: list[str]
    dry_run: bool


@dataclass(frozen=True, slots=True)
class _Plan:
    """All that is known before anything is written.

    Attributes:
        files: new content by name.
        present: what lies there now under names of the old and the new state.
        now: description of the state in place; None if nothing was rolled out.
    """

    files: Mapping[str, bytes]
    present: Mapping[str, bytes]
    now: Applied | None
    told: RolledOut


def apply(bundle: Path, trust: Path, machine: str, config: Path, *, dry_run: bool) -> Answer:
    """Check a bundle, print what it changes on this machine, and put it in place.

    Args:
        trust: public key of whoever may sign.
        machine: name of this machine in the bundle.
        config: configuration file of the service; may be missing on a new machine.
        dry_run: write nothing.

    Raises:
        RolloutError, ConfigError: it does not fit, or the service would refuse it; then nothing
            has changed.
    """
    opened = open_bundle(bundle, trust)
    described = _for_us(opened, bundle, machine)
    place = Place(config)
    with _one_line(config):
        if dry_run:
            return _answer(_plan(opened, machine, described, place, dry_run=True).told)
        with place.held():
            plan = _plan(opened, machine, described, place, dry_run=False)
            _put(opened, machine, described, place, plan)
            return _answer(plan.told)


def back(config: Path, *, force: bool = False) -> Answer:
    """Put the state before the last bundle in place again.

    Args:
        force: even if files were changed since, or the service refuses the earlier state.

    Raises:
        RolloutError: there is none, or something speaks against it; then nothing has changed.
    """
    place = Place(config)
    with _one_line(config):
        if not place.root.is_dir():
            raise RolloutError(f"{config}: nothing was rolled out here")
        with place.held():
            now = place.now
            if now is None or not now.before:
                raise RolloutError(f"{config}: there is no earlier state to go back to")
            earlier = place.applied(now.before)
            changed_here = place.changed_here()
            if changed_here and not force:
                words = f"{', '.join(changed_here)}: changed here since; --force gives that up"
                raise RolloutError(words)
            files = place.staged(now.before)
            unreachable: list[str] = []
            if not force:
                unreachable = check_new(config, files, set(now.files)).not_reachable
            present = place.contents(set(now.files) | set(files))
            place.take_over()
            place.switch(now.before)
            told = RolledOut(
                machine=earlier.machine,
                before=now.number,
                now=earlier.number,
                configuration=earlier.configuration,
                changes=changes(present, files),
                changed_here=changed_here,
                not_reachable=unreachable,
                dry_run=False,
            )
            return _answer(told)


@contextmanager
def _one_line(config: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RolloutError(f"{error.filename or config}: {error.strerror}") from None


def _for_us(bundle: Bundle, path: Path, machine: str) -> BundledMachine:
    """The machine's part of a bundle for this version. Raises RolloutError."""
    manifest = bundle.manifest
    if machine not in manifest.machines:
        names = ", ".join(sorted(manifest.machines))
        raise RolloutError(f"{path}: is for {names} of site {manifest.site}, not for {machine!r}")
    if minor(__version__) not in manifest.versions:
        versions = ", ".join(manifest.versions)
        raise RolloutError(f"{path}: is for edge-service {versions}; this is {__version__}")
    return manifest.machines[machine]


def _plan(
    bundle: Bundle, machine: str, described: BundledMachine, place: Place, *, dry_run: bool
) -> _Plan:
    manifest, config = bundle.manifest, place.config
    _check_owner(place, manifest.site, machine)
    highest = place.highest()
    if manifest.number <= highest:
        words = f"bundle {manifest.number} is not newer than bundle {highest}, which was here"
        raise RolloutError(f"{words}; pack it again with --number {highest + 1}")
    files = dict(bundle.files[machine])
    content = files.pop(described.config)
    if config.name in files:
        raise RolloutError(f"{config.name}: is also the name of another file of the bundle")
    files[config.name] = content
    now = place.now
    governed = set(now.files) if now else set()
    present = place.contents(governed | set(files))
    checked = check_new(config, files, governed)
    machines = {config.name, *(Path(axis.machine).name for axis in checked.axes)}
    at_once = frozenset(name for name in files if Path(name).name not in machines)
    told = RolledOut(
        machine=machine,
        before=now.number if now else None,
        now=manifest.number,
        configuration=described.configuration,
        changes=changes(present, files, at_once),
        changed_here=place.changed_here(),
        not_reachable=checked.not_reachable,
        dry_run=dry_run,
    )
    return _Plan(files, present, now, told)


def _check_owner(place: Place, site: str, machine: str) -> None:
    """Refuse a bundle for another machine than the one whose configuration lies here."""
    if not place.config.exists():
        return
    try:
        service = tomllib.loads(place.config.read_bytes().decode()).get("service", {})
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise RolloutError(f"{place.config}: is not valid TOML: {error}") from None
    here = (service.get("site", "bench"), service.get("machine", "lfd"))
    if here != (site, machine):
        words = f"{place.config}: this is {here[1]} of site {here[0]}"
        raise RolloutError(f"{words}; the bundle is for {machine} of site {site}")


def _put(
    bundle: Bundle, machine: str, described: BundledMachine, place: Place, plan: _Plan
) -> None:
    """Set aside what is there unless it is a state already, and put the new state in place."""
    needed = sum(map(len, (*plan.files.values(), *plan.present.values())))
    if shutil.disk_usage(place.folder).free < needed + _SPARE_BYTES:
        raise RolloutError(f"{place.folder}: the disk is full")
    place.tidy()
    manifest, now = bundle.manifest, plan.now
    changed = bool(plan.told.changed_here)
    is_state = now is not None and not changed and place.are_links(set(now.files))
    if plan.present and not (is_state and now and set(plan.present) == set(now.files)):
        aside = Applied(
            number=now.number if now and not changed else None,
            site=manifest.site,
            machine=machine,
            made=datetime.fromtimestamp(now_ns() / 1e9, UTC).isoformat(timespec="seconds"),
            made_by=now.made_by if now and not changed else _NEVER,
            configuration=now.configuration if now and not changed else "",
            signer=now.signer if now and not changed else "",
            files={name: digest_of(content) for name, content in plan.present.items()},
            before=place.current if place.is_whole(place.current) else now.before if now else "",
        )
        name = f"before-{manifest.number}"
        place.stage(name, plan.present, aside)
        place.switch(name)
        place.take_over()
    applied = Applied(
        number=manifest.number,
        site=manifest.site,
        machine=machine,
        made=manifest.made,
        made_by=manifest.made_by,
        configuration=described.configuration,
        signer=bundle.signer,
        files={name: digest_of(content) for name, content in plan.files.items()},
        before=place.current,
    )
    place.stage(str(manifest.number), plan.files, applied)
    place.switch(str(manifest.number))


def _answer(told: RolledOut) -> Answer:
    return Answer("\n".join(_lines(told)), told)


def _lines(told: RolledOut) -> Iterator[str]:
    would = "would be" if told.dry_run else "is"
    is_first = told.before is None and all(each.change == "added" for each in told.changes)
    old = "nothing" if is_first else _called(told.before)
    yield (
        f"{told.machine}: {_called(told.now)} {would} in place of {old}"
        + (f", configuration {told.configuration}" if told.configuration else "")
    )
    for name in told.changed_here:
        yield f"{name}: was changed here since {_called(told.before)}"
    yield from change_lines(told.changes)
    for line in told.not_reachable:
        yield f"not reachable now: {line}"
    if told.dry_run:
        yield "nothing was written"


def _called(number: int | None) -> str:
    return "the configuration from before" if number is None else f"bundle {number}"
