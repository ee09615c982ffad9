"""Axes of many machines, the worst first: of services that are asked, and of Zenoh routers."""

import os
from base64 import b64encode
from collections.abc import Sequence
from http.client import HTTPConnection, HTTPException, HTTPSConnection
from netrc import NetrcParseError, netrc
from pathlib import Path
from urllib.parse import urlsplit

from pydantic import ValidationError
from rich.box import SIMPLE
from rich.console import Group
from rich.table import Table
from rich.text import Text

from ..bus.fleet import Place, RouterAwayError, ask_health
from ..clock import now_ns
from ..messages.addresses import is_http_url, is_loopback
from ..messages.answer import AxesAnswer, AxisRow, axis_row
from ..messages.estimate import EstimateStatus
from ..messages.event import AxisCondition
from ..messages.health import AxisHealth
from ..messages.interval import Frozen, printed, rfc3339
from ..threads import in_threads

ANSWER_S = 5.0
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
    """Addresses that are looked at again and again. Raises ValueError."""

    def __init__(self, addresses: Sequence[str]) -> None:
        self._addresses = addresses
        self._logins = {each: _login(each) for each in addresses if is_http_url(each)}
        self._known: set[tuple[str, Place]] = set()
        for address in addresses:
            bus = address.startswith(("tcp/", "tls/"))
            if address not in self._logins and not (bus and address.rpartition(":")[2].isdigit()):
                expected = "http://HOST:PORT, https://HOST:PORT, tcp/HOST:PORT or tls/HOST:PORT"
                raise ValueError(f"{address!r}: expected {expected}")

    def look(self) -> Fleet:
        """Rows of now; an axis that was there before and is gone is told."""
        found = in_threads(self._asked, self._addresses, len(self._addresses))
        rows = [row for rows in found for row in rows]
        rows.sort(key=lambda row: (row.urgency, row.site, row.machine, row.axis))
        worst = max((row.condition for row in rows), key=lambda each: each.urgency, default=None)
        return Fleet(condition=worst, axes=rows)

    def _asked(self, address: str) -> list[FleetRow]:
        if address in self._logins:
            return _service(address.rstrip("/"), self._logins[address])
        try:
            found = ask_health(address)
        except RouterAwayError as error:
            return [_unavailable(address, str(error))]
        self._known |= {(address, place) for place in found}
        places = sorted(place for known, place in self._known if known == address)
        return [_row(address, place, found) for place in places]


def _row(address: str, place: Place, found: dict[Place, AxisHealth | None]) -> FleetRow:
    named, health = dict(zip(("site", "machine", "axis"), place, strict=True)), found.get(place)
    if health is None:
        reason = "nothing that can be read comes" if place in found else "gone from the bus"
        return _unavailable(address, reason, **named)
    return FleetRow(**(dict(axis_row(health, now_ns())) | named), address=address)


def _unavailable(address: str, reason: str, axis: str = "", **place: str) -> FleetRow:
    condition, status = AxisCondition.UNAVAILABLE, EstimateStatus.UNESTIMATED
    members = {"axis": axis, "condition": condition, "status": status, "address": address}
    return FleetRow.model_validate(members | {"reason": reason} | place)


def _login(address: str) -> dict[str, str]:
    """Login of `.netrc`, as curl takes it; by TLS or on loopback only. Raises ValueError."""
    parts, file = urlsplit(address), Path(os.environ.get("NETRC") or Path.home() / ".netrc")
    host = parts.hostname or ""
    if not (file.is_file() and (parts.scheme == "https" or is_loopback(host))):
        return {}
    try:
        user, _, password = netrc(file).authenticators(host) or ("", "", "")
    except (NetrcParseError, OSError) as error:
        raise ValueError(str(error)) from None
    told = b64encode(f"{user}:{password}".encode()).decode()
    return {"authorization": f"Basic {told}"} if password else {}


def _service(address: str, login: dict[str, str]) -> list[FleetRow]:
    parts = urlsplit(address)
    kind = HTTPSConnection if parts.scheme == "https" else HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=ANSWER_S)
    try:
        connection.request("GET", f"{parts.path}/api/v1/axes", headers=login)
        response = connection.getresponse()
        if response.status != 200:
            return [_unavailable(address, f"answers with status {response.status}")]
        answer = AxesAnswer.model_validate_json(response.read(), extra="ignore")
    except TimeoutError:
        return [_unavailable(address, f"no answer within {ANSWER_S:g} s")]
    except ValidationError:
        return [_unavailable(address, "no answer of an edge-service")]
    except (HTTPException, OSError) as error:
        return [_unavailable(address, f"cannot be reached ({error})")]
    finally:
        connection.close()
    place = {"address": address, "site": answer.site, "machine": answer.machine}
    return [FleetRow(**dict(row), **place) for row in answer.axes]


def table_of(fleet: Fleet) -> Group:
    """A line on all, then a table with a line an axis or silent address."""
    counts = [(sum(row.level is each for row in fleet.axes), each) for each in AxisCondition]
    counted = ", ".join(f"{count} {each}" for count, each in counts if count)
    table = Table("MACHINE", "AXIS", "LEVEL", "OF FRESH", "NEXT LIMIT", "WHY", "TO DO", box=SIMPLE)
    for row in fleet.axes:
        machine = f"{row.site}/{row.machine}" if row.axis else row.address
        why = row.reason or (row.headline.text if row.headline else "")
        task = row.advice[0].text if row.advice else ""
        share = ""
        if row.of_fresh is not None:
            value, low, high = printed(row.of_fresh.value, row.of_fresh.low, row.of_fresh.high)
            share = f"{value} % ({low} to {high})"
        cells = (machine, row.axis, str(row.level), share, _limit(row), why, task)
        table.add_row(*(Text(each) for each in cells), style=_STYLES[row.level])
    worst = f"{fleet.axes[0].level}: {counted}" if fleet.axes else "no axis is there"
    return Group(Text(worst), table)


def _limit(row: FleetRow) -> str:
    limit = row.next_limit
    if limit is None or limit.earliest_ns is None:
        return ""
    dates = f"not before {rfc3339(limit.earliest_ns)[:16]}Z"
    if limit.latest_ns is not None:
        dates = f"{rfc3339(limit.earliest_ns)[:16]} to {rfc3339(limit.latest_ns)[:16]}Z"
    return f"{limit.limit} {dates.replace('T', ' ')}"
