"""Hostile requests, drawn from the service's own description: every route, and none there is."""

import json
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

METHODS = ("GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "FOO")
STRINGS = (
    *("", "nan", "inf", "-1", "0", "1e308", "1e400", "9" * 400, "0x10", "1_000", "１２", "true"),
    *("2026-01-01T00:00:00Z", "9999-12-31T23:59:59Z", "0001-01-01T00:00:00Z", "now", "null"),
    *("253402300800", "-0", "+5", " 5 ", "[]", "{}", "' OR 1=1", "\0", "\ud800", "💩", "a" * 3000),
    *("../../etc/passwd", "..%2f..%2fx.csv", ".hidden.csv", "x.csv\n", "--help.csv", "X/../Y"),
)
VALUES: Any = (None, True, -1, 0, 2**63, 10**30, 1e308, float("nan"), [], {}, [[]], [None] * 60)
KINDS = ("application/json", "text/csv", "application/vnd.apache.parquet", "text/plain", "x", "")
GARBAGE = (b"", b"{", b"[" * 5000, b'{"a":' * 5000, b"\xff\xfe\0", b"1,2\n" * 9, b"\0" * 200_000)
KNOWN = {"axis": "X", "name": "a.csv", "id": "1", "output": "mqtt"}


@dataclass(frozen=True, slots=True)
class HostileRequest:
    """One request; header values and target are ASCII."""

    method: str
    target: str
    headers: tuple[tuple[str, str], ...]
    body: bytes
    chunked: bool = False

    def raw(self, host: str) -> bytes:
        """The request as it goes over the wire, on a connection of its own."""
        headers = (("Host", host), ("Connection", "close"), *self.headers)
        framing = "Transfer-Encoding: chunked" if self.chunked else f"Content-Length: {self._size}"
        lines = [f"{self.method} {self.target} HTTP/1.1", *(f"{k}: {v}" for k, v in headers)]
        head = "\r\n".join([*lines, framing, "", ""]).encode("latin-1")
        return head + (self._chunks() if self.chunked else self.body)

    @property
    def _size(self) -> int:
        return len(self.body)

    def _chunks(self) -> bytes:
        parts = [self.body[start : start + 1000] for start in range(0, len(self.body), 1000)]
        return b"".join(b"%x\r\n%b\r\n" % (len(part), part) for part in [*parts, b""])


def hostile_requests(description: Mapping[str, Any], seed: int) -> Iterator[HostileRequest]:
    """Requests without end, the same for the same seed.

    Args:
        description: content of `/openapi.json`.
    """
    chance = random.Random(seed)
    paths = [*description["paths"], "/", "/static/{name}", "/{name}", "/api/v1/{axis}/{name}"]
    while True:
        template = chance.choice(paths)
        operations = description["paths"].get(template, {})
        known = [each.upper() for each in operations]
        method = chance.choice(known if known and chance.random() < 0.7 else METHODS)
        operation = operations.get(method.lower(), {})
        target = _target(chance, template, operation)
        kind = chance.choice(KINDS)
        headers = [*_headers(chance), *([("Content-Type", kind)] if kind else [])]
        body = _body(chance, description, operation) if method not in ("GET", "HEAD") else b""
        yield HostileRequest(method, target, tuple(headers), body, chance.random() < 0.2)


def _target(chance: random.Random, template: str, operation: Mapping[str, Any]) -> str:
    path = template
    for name, known in KNOWN.items():
        value = known if chance.random() < 0.7 else chance.choice(STRINGS)
        path = path.replace(f"{{{name}}}", _quoted(value))
    named = [each["name"] for each in operation.get("parameters", ()) if each["in"] == "query"]
    picked = [name for name in [*named, "x"] if chance.random() < 0.5]
    query = "&".join(f"{name}={_quoted(chance.choice(STRINGS))}" for name in picked)
    return f"{path}?{query}" if query else path


def _headers(chance: random.Random) -> Iterator[tuple[str, str]]:
    if chance.random() < 0.1:
        yield "Range", chance.choice(["bytes=0-0", "bytes=9-1", "x", "bytes=" + "0-1," * 1000])
    if chance.random() < 0.2:
        yield "Last-Event-ID", _quoted(chance.choice(STRINGS))
    if chance.random() < 0.1:
        yield "Origin", chance.choice(["null", "", "file://", "http://evil.example"])
    if chance.random() < 0.05:
        yield "X-Long", "a" * chance.choice([8000, 20_000])
    if chance.random() < 0.05:
        yield "Expect", "100-continue"


def _body(
    chance: random.Random, description: Mapping[str, Any], operation: Mapping[str, Any]
) -> bytes:
    example = _example(description, operation)
    if example is None or chance.random() < 0.3:
        return chance.choice(GARBAGE)
    for _ in range(chance.randrange(3)):
        name = chance.choice([*example, "unknown"])
        if chance.random() < 0.2:
            example.pop(name, None)
        else:
            example[name] = chance.choice([*VALUES, *STRINGS])
    return json.dumps(example).encode()


def _example(description: Mapping[str, Any], operation: Mapping[str, Any]) -> dict[str, Any] | None:
    """A right body of an operation, if it takes one: its example, or its properties' own."""
    content = operation.get("requestBody", {}).get("content", {}).get("application/json", {})
    schema = content.get("schema", {})
    name = schema.get("$ref", "").rpartition("/")[2]
    schema = description["components"]["schemas"].get(name, schema)
    examples = [content.get("example"), *schema.get("examples", ())]
    found = next((each for each in examples if isinstance(each, dict)), None)
    return None if found is None else dict(found)


def _quoted(value: str) -> str:
    return quote(value, safe="", errors="surrogatepass")
