"""Answers of a service that hears nothing: all that it says comes from the folder it keeps."""

import json
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from edge_service.http_api.times import rfc3339_s

from .scene import RunningService

_STEP_S = 60.0
_PATIENCE_S, _LOOK_PERIOD_S = 20.0, 0.2
_TIME = re.compile(r'"\d{4}-\d\d-\d\dT[\d:.]+Z"')
_PROBLEM = " problem"
_PRESENT = " components"
"""States of the parts of a service are of the present, whatever the folder holds."""
_SETTLE_S = 2.5
"""Until states are read and published, and damage is found by whoever looks for it."""
_SPREAD = ("preload_percent", "drag_torque_nm", "nis", "stiffness_n_per_m", "temperature_c")
Leaf = tuple[str, str]
Buckets = dict[str, dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Answers:
    """Answers of a service about one axis, apart from those about the present.

    Attributes:
        leaves: paths within the answers, with values as JSON.
        buckets: of the history, by start.
    """

    leaves: frozenset[Leaf]
    buckets: Buckets

    def false_ones(
        self, truth: "Answers", empty: "Answers", free: frozenset[str], until_s: float
    ) -> list[Leaf]:
        """Answers that were neither kept nor are those of a folder in which nothing is.

        An answer that says itself what is gone or changed (`problem`) is none of them.

        Args:
            free: paths whose values differ from run to run.
            until_s: UNIX time before which all was kept; what is dated later is of the present.
        """
        known = truth.leaves | empty.leaves
        begun = json.dumps(rfc3339_s(until_s))
        wrong = [
            (path, value)
            for path, value in self.leaves - known
            if path not in free
            and value != "null"
            and not _is_later(value, begun)
            and not self._is_told(path, value)
        ]
        return wrong + [
            ("history", json.dumps(bucket))
            for start, bucket in self.buckets.items()
            if not _is_part(bucket, truth.buckets.get(start))
        ]

    def _is_told(self, path: str, value: str) -> bool:
        """Tell whether the answer itself says that it is not whole, or that this part is not."""
        if path.endswith(_PROBLEM):
            return True
        if path.endswith("[]"):
            part = json.loads(value)
            return isinstance(part, dict) and bool(part.get(_PROBLEM.strip()))
        said = dict(self.leaves).get(f"{path.rpartition(' ')[0]}{_PROBLEM}")
        return said not in (None, '""')


def _is_later(value: str, begun: str) -> bool:
    """Tell whether a value is a time after another, both RFC 3339 in JSON."""
    return bool(_TIME.fullmatch(value)) and value > begun


def _is_part(bucket: dict[str, Any], whole: dict[str, Any] | None) -> bool:
    """Tell whether a bucket is the whole one, or what is left of it."""
    if whole is None or bucket["samples"] > whole["samples"]:
        return False
    if bucket["samples"] == whole["samples"]:
        return bucket == whole
    spreads = [(bucket[name], whole[name]) for name in _SPREAD if bucket[name] is not None]
    return all(
        all_of is not None and all_of["min"] <= part["min"] <= part["max"] <= all_of["max"]
        for part, all_of in spreads
    )


def differing(one: Answers, other: Answers) -> frozenset[str]:
    """Paths whose values differ between two runs on the same folder."""
    return frozenset(path for path, _ in one.leaves ^ other.leaves)


def ask(service: RunningService, axes: tuple[str, ...], until_s: float) -> dict[str, Answers]:
    """Ask a service for all that it knows of each axis up to a UNIX time."""
    _wait_heard(service, axes)
    time.sleep(_SETTLE_S)
    paths = _paths(service)
    return {axis: _ask_of(service, paths, axis, until_s) for axis in axes}


def _wait_heard(service: RunningService, axes: tuple[str, ...]) -> None:
    """Wait until the condition of every axis was heard."""
    until_s = time.monotonic() + _PATIENCE_S
    while time.monotonic() < until_s:
        uses = [service.ask(f"/api/v1/axes/{axis}/use").json for axis in axes]
        if None not in uses:
            return
        time.sleep(_LOOK_PERIOD_S)


def _ask_of(service: RunningService, paths: list[str], axis: str, until_s: float) -> Answers:
    leaves: set[Leaf] = set()
    for path in paths:
        answer = service.ask(path.replace("{axis}", axis) + _query(path, until_s))
        if answer.status != 200:
            raise AssertionError(f"{path}: {answer.status} {answer.body[:200]!r}")
        leaves |= set(_leaves(answer.json, path, rfc3339_s(until_s)))
    span = f"from={until_s - 86400.0}&to={until_s}&step={_STEP_S}"
    history = service.ask(f"/api/v1/axes/{axis}/history?{span}")
    if history.status != 200:
        raise AssertionError(f"history: {history.status} {history.body[:200]!r}")
    buckets = {str(each["time"]): each for each in history.json["buckets"]}
    return Answers(frozenset(leaves), buckets)


def _query(path: str, until_s: float) -> str:
    return f"?to={until_s}&limit=20000" if path.endswith("/log") else ""


def _paths(service: RunningService) -> list[str]:
    """Routes that answer in JSON and ask for no more than an axis; new ones are found too."""
    described = service.ask("/openapi.json").json["paths"]
    found = []
    for path, methods in described.items():
        route = methods.get("get")
        if route is None or path.replace("{axis}", "").count("{") or path.endswith("/history"):
            continue
        if "application/json" in route["responses"].get("200", {}).get("content", {}):
            found.append(path)
    return [path for path in found if path not in _OF_NOW]


_OF_NOW = ("/readyz", "/healthz", "/api/v1/health", "/api/v1/axes/{axis}/diagnosis")


def _leaves(value: Any, path: str, until: str) -> Iterator[Leaf]:
    """Members of an answer; those of a list wherever they stand in it, unless of the present."""
    if path.endswith(_PRESENT):
        return
    if isinstance(value, dict):
        for name, each in value.items():
            yield from _leaves(each, f"{path} {name}", until)
    elif isinstance(value, list):
        for each in value:
            if not (isinstance(each, dict) and str(each.get("time") or "") > until):
                yield f"{path}[]", json.dumps(each, sort_keys=True)
    else:
        yield path, json.dumps(value)
