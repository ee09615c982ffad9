"""Axes of many machines, the worst first: of services that are asked, and of Zenoh routers."""

import asyncio
import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from pydantic import ValidationError
from rich.box import SIMPLE
from rich.console import Group
from rich.table import Table
from rich.text import Text

from ..bus.fleet import HealthListener, HeardAxis, RouterAwayError
from ..clock import now_ns
from ..messages.addresses import is_http_url, is_loopback
from ..messages.answer import AxesAnswer, AxisRow, axis_row
from ..messages.estimate import EstimateStatus
from ..messages.event import AxisCondition
from ..messages.interval import Frozen, printed, rfc3339
from ..threads import Threads

ANSWER_S = 5.0  # for all answers together
_STYLES = dict(zip(AxisCondition, ("bold red", "yellow", "dim", "green"), strict=True))


class FleetRow(AxisRow):
    """One axis, or an address that nothing is known of (then `axis` is empty)."""

    address: str
    site: str = ""
    machine: str = ""
    reason: str = ""  # why there is no answer; empty where there is one


class Fleet(Frozen):
    """Every axis: the worst condition, and the rows, the worst first."""

    condition: AxisCondition | None
    axes: list[FleetRow]


class FleetWatch:
    """Addresses that are looked at again and again; sessions at routers stay open.

    Raises ValueError, SyntaxError.
    """

    def __init__(self, addresses: Sequence[str]) -> None:
        self._services: dict[str, httpx.Auth | None] = {}
        self._routers: dict[str, HealthListener | None] = {}
        for address in addresses:
            if is_http_url(address):
                self._services[address.rstrip("/")] = _login(address)
            elif address.startswith(("tcp/", "tls/")) and address.rpartition(":")[2].isdigit():
                self._routers[address] = None
            else:
                expected = "http://HOST:PORT, https://HOST:PORT, tcp/HOST:PORT or tls/HOST:PORT"
                raise ValueError(f"{address!r}: expected {expected}")

    def look(self) -> Fleet:
        """Rows of now; takes up to `ANSWER_S` where somebody is silent."""
        rows = asyncio.run(self._look())
        rows.sort(key=lambda row: (row.urgency, row.site, row.machine, row.axis))
        return Fleet(condition=rows[0].condition if rows else None, axes=rows)

    def close(self) -> None:
        """End the sessions."""
        for listener in filter(None, self._routers.values()):
            listener.close()

    async def _look(self) -> list[FleetRow]:
        threads = Threads("fleet", len(self._routers))
        asked = [_service(*each) for each in self._services.items()]
        heard = [threads.run(self._router, address) for address in self._routers]
        return [row for rows in await asyncio.gather(*asked, *heard) for row in rows]

    def _router(self, address: str) -> list[FleetRow]:
        listener = self._routers[address]
        try:
            if listener is None:
                listener = self._routers[address] = HealthListener(address)
        except RouterAwayError as error:
            return [_unavailable(address, str(error))]
        listener.settle(ANSWER_S)
        return [_row_of(address, axis) for axis in listener.axes()]


def _row_of(address: str, heard: HeardAxis) -> FleetRow:
    place = {"site": heard.site, "machine": heard.machine, "axis": heard.axis}
    health = heard.health
    if health is None:
        reason = "nothing that can be read comes" if heard.there else "gone from the bus"
        return _unavailable(address, reason, **place)
    return FleetRow(**(dict(axis_row(health, now_ns())) | place), address=address)


def _unavailable(address: str, reason: str, axis: str = "", **place: str) -> FleetRow:
    """A row without any number."""
    condition, status = AxisCondition.UNAVAILABLE, EstimateStatus.UNESTIMATED
    members = {"axis": axis, "condition": condition, "status": status, "address": address}
    return FleetRow.model_validate(members | {"reason": reason} | place)


def _login(address: str) -> httpx.Auth | None:
    """Login of `.netrc`, as curl takes it; by TLS or on loopback only. Raises SyntaxError."""
    parts, file = urlsplit(address), Path(os.environ.get("NETRC") or Path.home() / ".netrc")
    guarded = parts.scheme == "https" or is_loopback(parts.hostname or "")
    return httpx.NetRCAuth(str(file)) if guarded and file.is_file() else None


async def _service(address: str, login: httpx.Auth | None) -> list[FleetRow]:
    """Rows of one service."""
    try:
        async with asyncio.timeout(ANSWER_S), httpx.AsyncClient(auth=login) as client:
            response = await client.get(f"{address}/api/v1/axes")
        if response.status_code != httpx.codes.OK:
            return [_unavailable(address, f"answers with status {response.status_code}")]
        answer = AxesAnswer.model_validate_json(response.content, extra="ignore")
    except TimeoutError:
        return [_unavailable(address, f"no answer within {ANSWER_S:g} s")]
    except ValidationError:
        return [_unavailable(address, "no answer of an edge-service")]
    except (httpx.HTTPError, OSError, ValueError) as error:
        return [_unavailable(address, f"cannot be reached ({error})")]
    place = {"address": address, "site": answer.site, "machine": answer.machine}
    return [FleetRow(**dict(row), **place) for row in answer.axes]


def table_of(fleet: Fleet) -> Group:
    """A line on all, then a table with a line an axis or silent address."""
    counts = [(sum(row.condition is each for row in fleet.axes), each) for each in AxisCondition]
    counted = ", ".join(f"{count} {each}" for count, each in counts if count)
    table = Table(
        "MACHINE", "AXIS", "CONDITION", "OF FRESH", "NEXT LIMIT", "WHY", "TO DO", box=SIMPLE
    )
    for row in fleet.axes:
        machine = f"{row.site}/{row.machine}" if row.axis else row.address
        why = row.reason or (row.headline.text if row.headline else "")
        task = row.advice[0].text if row.advice else ""
        cells = (machine, row.axis, str(row.condition), _percent(row), _limit(row), why, task)
        table.add_row(*(Text(each) for each in cells), style=_STYLES[row.condition])
    return Group(Text(f"{fleet.condition}: {counted}" if counted else "no axis is there"), table)


def _percent(row: FleetRow) -> str:
    if row.of_fresh is None:
        return ""
    value, low, high = printed(row.of_fresh.value, row.of_fresh.low, row.of_fresh.high, 0)
    return f"{value} % ({low} to {high})"


def _limit(row: FleetRow) -> str:
    """The next limit with its dates, UTC to the minute."""
    limit = row.next_limit
    if limit is None or limit.earliest_ns is None:
        return ""
    dates = f"not before {rfc3339(limit.earliest_ns)[:16]}Z"
    if limit.latest_ns is not None:
        dates = f"{rfc3339(limit.earliest_ns)[:16]} to {rfc3339(limit.latest_ns)[:16]}Z"
    return f"{limit.limit} {dates.replace('T', ' ')}"
