"""Axes as the page shows and makes them: `axes/{axis}/` of the state folder each."""

import asyncio
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import tomlkit

from ..atomic import PRIVATE, replaced_file
from ..clock import now_ns
from ..config import DEFAULT_MACHINE, AxisConfig, ConfigError, load_machine, read_axis
from ..http_api.problems import RefusedError
from ..http_api.routes.config import AxisConfiguration
from ..messages.keys import check_part
from ..models.machine import Machine
from ..threads import Threads
from .acquire_node import check_source
from .context import NodeContext
from .stages import make_estimator

HIDDEN = "***"
"""A password, as it is shown."""


class AxisDesk:
    """The axes of one service; those of the state folder may be made, changed and removed."""

    def __init__(self, context: NodeContext) -> None:
        self._context = context
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
        return answer, tomlkit.dumps({"axes": [table]})

    async def put(self, axis: str, asked: AxisConfiguration) -> bool:
        """Check an axis as check-config does, keep it and begin it; returns whether it is new.

        Raises RefusedError: nothing has changed then.
        """
        async with self._one:
            with _refusing(axis):
                file, before = self._file(axis), self._known().get(axis)
                content = asked.machine
                if before is None:
                    content = content or _content(load_machine(DEFAULT_MACHINE))
                elif content == _content(self._context.machines[axis]):
                    content = None
                added = content and await self._threads.run(_add_machine, file.parent, content)
                try:
                    text = _table(axis, asked, added or before.machine, before)
                    own = read_axis(file, text.encode())
                    machine = load_machine(own.machine)
                    self._context.config.with_axis(own)
                    make_estimator(self._context.config.estimator, machine)
                    await check_source(own)
                    await self._threads.run(_write, file, text)
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
                await self._threads.run(shutil.rmtree, file.parent)
            self._context.drop(axis)

    def _known(self) -> dict[str, AxisConfig]:
        return {each.name: each for each in self._context.config.axes}

    def _file(self, axis: str) -> Path:
        """File of an axis of the page. Raises RefusedError: another owns it, or nothing is kept."""
        state, own = self._context.config.store.folder, self._known().get(axis)
        if check_part(axis).startswith("."):
            raise ValueError(f"{axis!r}: expected a letter or digit first")
        file = None if state is None else state / "axes" / axis / "axis.toml"
        if own is not None and (file is None or own.file != file):
            line = f"{own.file}{_line_of(own)}: axis {axis} stands there"
            raise RefusedError(409, f"{line}: change it there, then reload the service (SIGHUP)")
        if file is None:
            raise RefusedError(409, "store.folder: missing; axes of the page are kept there")
        return file


@contextmanager
def _refusing(axis: str) -> Iterator[None]:
    """What is wrong with a configuration, or the disk, as a refusal."""
    try:
        yield
    except ConfigError as error:
        raise RefusedError(422, "; ".join(error.mistakes)) from None
    except ValueError as error:
        raise RefusedError(422, str(error)) from None
    except OSError as error:
        raise RefusedError(507, f"axis {axis}: cannot be kept ({error.strerror})") from None


def _content(machine: Machine) -> dict[str, Any]:
    """Content of a machine file."""
    return machine.model_dump(mode="json", exclude_none=True)


def _add_machine(folder: Path, content: dict[str, Any]) -> Path:
    """Write a machine file beside those that were there: they stay, dated. Raises OSError."""
    path, day = folder / "machine.toml", datetime.fromtimestamp(now_ns() / 1e9, UTC)
    number = 1
    while path.exists():
        path = folder / f"machine-{day:%Y-%m-%d}{f'.{number}' if number > 1 else ''}.toml"
        number += 1
    with replaced_file(path) as file:
        file.write(tomlkit.dumps(content))
    return path


def _forget(machine_file: Path) -> None:
    """Remove a machine file that is not used, and its folder if nothing else is there."""
    with suppress(OSError):
        machine_file.unlink()
        machine_file.parent.rmdir()


def _table(
    axis: str, asked: AxisConfiguration, machine_file: Path, before: AxisConfig | None
) -> str:
    """Table of an axis as TOML; a password that is sent as it is shown stays what it was."""
    settings = dict(asked.settings)
    if before is not None and settings.get("password") == HIDDEN:
        settings["password"] = before.settings.get("password")
    table = {"name": axis, "machine": machine_file.name, "driver": asked.driver, **asked.limits}
    return tomlkit.dumps({"axes": [table | {"settings": settings}]})


def _write(file: Path, text: str) -> None:
    with replaced_file(file, PRIVATE) as out:
        out.write(text)


def _line_of(axis: AxisConfig) -> str:
    """Line at which an axis is named in its file, as `:12`; empty where none is found."""
    with suppress(OSError, TypeError):
        named = re.compile(rf"""\s*name\s*=\s*["']{re.escape(axis.name)}["']""")
        for number, line in enumerate(axis.file.read_text("utf-8").splitlines(), 1):
            if named.match(line):
                return f":{number}"
    return ""
