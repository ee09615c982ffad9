"""The desks at which the page asks: for axes that it shows and makes, for outputs, for metrics."""

import asyncio
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..atomic import PRIVATE, write_whole
from ..clock import now_ns
from ..config import DEFAULT_MACHINE, AxisConfig, ConfigError, load_machine, read_axis
from ..health.service_state import ServiceState
from ..http_api.problems import RefusedError
from ..http_api.routes.config import AxisConfiguration
from ..http_api.routes.service import Outputs
from ..messages.keys import check_part
from ..messages.topics import FEAT, PRELOAD
from ..models.machine import Machine
from ..outputs.base import OutputConfig, OutputContext, load_output
from ..plugins import UnknownPluginError
from ..threads import Threads
from .acquire_node import check_source
from .context import NodeContext
from .stages import make_estimator

HIDDEN = "***"
"""A password, as it is shown."""


class AxisDesk:
    """The axes of one service; those of its folder may be made, changed and removed."""

    def __init__(self, context: NodeContext, folder: Path) -> None:
        self._context, self._folder = context, folder.absolute()
        self._threads, self._one = Threads("axes"), asyncio.Lock()

    def read(self, axis: str) -> tuple[AxisConfiguration, str]:
        """Configuration of an axis that is there, and its table as TOML."""
        config, own = self._context.config, self._known()[axis]
        warning, fault = config.limits_percent(axis)
        table = own.model_dump(mode="json", exclude_none=True)
        if "password" in table["settings"]:
            table["settings"]["password"] = HIDDEN
        answer = AxisConfiguration(
            axis=axis,
            driver=own.driver,
            settings=table["settings"],
            limits={"warning_percent": warning, "fault_percent": fault},
            machine=_content(self._context.machines[axis]),
        )
        return answer, _toml({"axes": [table]})

    async def put(self, axis: str, asked: AxisConfiguration) -> bool:
        """Check, keep and begin an axis; returns whether it is new. Raises RefusedError."""
        async with self._one:
            with _refusing(axis):
                file, before = self._file(axis), self._known().get(axis)
                content, added = asked.machine, None
                if before is None:
                    content = content or _content(load_machine(DEFAULT_MACHINE))
                elif content == _content(self._context.machines[axis]):
                    content = None
                if content is not None:
                    added = await self._threads.run(_add_machine, file.parent, content)
                try:
                    text = _table(axis, asked, added, before)
                    own = read_axis(file, text.encode())
                    _check_place(own)
                    machine = load_machine(own.machine)
                    self._context.config.with_axis(own)
                    make_estimator(self._context.config.estimator, machine)
                    await check_source(own)
                    await self._threads.run(write_whole, file, text, PRIVATE)
                except BaseException:
                    if added:
                        await self._threads.run(_forget, added)
                    raise
            self._context.renew(own, machine)
            return before is None

    async def remove(self, axis: str) -> None:
        """Remove an axis that was made on the page; its history stays. Raises RefusedError."""
        async with self._one:
            with _refusing(axis):
                file = self._file(axis)
                await self._threads.run(file.unlink)
                await self._threads.run(shutil.rmtree, file.parent, True)  # what is left is no axis
            self._context.drop(axis)

    def _known(self) -> dict[str, AxisConfig]:
        return {each.name: each for each in self._context.config.axes}

    def _file(self, axis: str) -> Path:
        """File of an axis of the page. Raises RefusedError: another owns it."""
        own = self._known().get(check_part(axis))
        file = self._folder / "axes" / axis / "axis.toml"
        if own is not None and own.file != file:
            line = f"{own.file}{_line_of(own)}: axis {axis} stands there"
            raise RefusedError(409, f"{line}: change it there, then reload the service (SIGHUP)")
        return file


@contextmanager
def _refusing(axis: str) -> Iterator[None]:
    """Mistake in a configuration, or of the disk, as a refusal."""
    try:
        yield
    except ConfigError as error:
        raise RefusedError(422, "; ".join(error.mistakes)) from None
    except ValueError as error:
        raise RefusedError(422, str(error)) from None
    except OSError as error:
        raise RefusedError(507, f"axis {axis}: cannot be kept ({error.strerror})") from None


def _check_place(axis: AxisConfig) -> None:
    """Check that it reads no file of others: what it says of one may show what is in it."""
    assert axis.file is not None
    state = axis.file.parents[2].resolve()
    for key in ("path", "folder", "truth"):
        named = axis.settings.get(key)
        if named and not (axis.file.parent / str(named)).resolve().is_relative_to(state):
            raise ValueError(
                f"settings.{key}: an axis of the page reads files of the state folder ({state}) "
                "alone; state others in the configuration"
            )


def _content(machine: Machine) -> dict[str, Any]:
    return machine.model_dump(mode="json", exclude_none=True)


def _add_machine(folder: Path, content: dict[str, Any]) -> Path:
    """Write a machine file beside those that were there: they stay, dated. Raises OSError."""
    path, day = folder / "machine.toml", datetime.fromtimestamp(now_ns() / 1e9, UTC)
    number = 1
    while path.exists():
        path = folder / f"machine-{day:%Y-%m-%d}{f'.{number}' if number > 1 else ''}.toml"
        number += 1
    write_whole(path, _toml(content))
    return path


def _toml(content: dict[str, Any]) -> str:
    from tomlkit import dumps  # slow to import

    return dumps(content)


def _forget(machine_file: Path) -> None:
    """Remove a machine file that is not used, and its folder if nothing else is there."""
    with suppress(OSError):
        machine_file.unlink()
        machine_file.parent.rmdir()


def _table(
    axis: str, asked: AxisConfiguration, added: Path | None, before: AxisConfig | None
) -> str:
    """Table of an axis as TOML; what is not sent, or a password as it is shown, stays."""
    table: dict[str, Any] = {"name": axis, "driver": asked.driver} | dict(asked.limits)
    table["settings"] = dict(asked.settings)
    for key in table["settings"]:
        if key.endswith("_file"):  # of the service's own secrets, sent to a host of the asker's
            raise ValueError(f"settings.{key}: an axis of the page states the secret itself")
    if added is not None:
        table["machine"] = added.name
    if before is not None:
        table.setdefault("machine", before.machine.name)
        if table["settings"].get("password") == HIDDEN:
            table["settings"]["password"] = before.settings.get("password")
    return _toml({"axes": [table]})


def _line_of(axis: AxisConfig) -> str:
    """Line at which an axis is named in its file, as `:12`; empty where none is found."""
    named = re.compile(rf"""\s*name\s*=\s*["']{re.escape(axis.name)}["']""")
    lines: list[str] = []
    with suppress(OSError):
        lines = axis.file.read_text("utf-8").splitlines() if axis.file else []
    return next((f":{number}" for number, line in enumerate(lines, 1) if named.match(line)), "")


_READS = {"http": PRELOAD.name, "estimate": FEAT.name}
"""Topic whose payloads a component counts."""


class Scrape:
    """Answers a scrape by Prometheus with what holds now; `output` is None where it is missing."""

    def __init__(self, context: NodeContext, state: ServiceState, outputs: Outputs) -> None:
        self._state, self._outputs = state, outputs
        self.output: Any = None
        with suppress(UnknownPluginError):
            place = context.config.service
            facts = OutputContext("metrics", place.site, place.machine)
            self.output = load_output("metrics")(OutputConfig(), facts)

    async def text(self) -> tuple[bytes, str]:
        """Text and its content type."""
        state, at_ns = self._state, now_ns()
        temperature_c = {}
        dropped: Counter[tuple[str, str]] = Counter()
        for axis in state.axes:
            newest = state.live(axis).newest
            if newest is not None and newest.temperature_c is not None:
                temperature_c[axis] = newest.temperature_c
        for report in state.components(at_ns, None):
            if report.component in _READS:
                dropped[_READS[report.component], "gap"] += report.counters.get("lost_payloads", 0)
        for (topic, _), count in state.refused().items():
            dropped[topic, "refused"] += count
        dropped["", "unknown"] += state.ignored_payloads
        outboxes = {}
        for name in self._outputs.names:
            with suppress(RefusedError):
                outboxes[name] = await self._outputs.counts(name)
        text = self.output.text(
            state.configuration,
            not state.unready(at_ns),
            [state.answer(axis, at_ns) for axis in state.axes],
            state.components(at_ns),
            temperature_c,
            dropped,
            outboxes,
        )
        return text, self.output.content_type
