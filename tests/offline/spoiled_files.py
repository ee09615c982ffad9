"""Hostile files: right ones of every kind, spoiled byte by byte or word by word."""

import contextlib
import io
import random
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edge_service.cli.entry import main
from edge_service.exit_status import BAD_INPUT, DONE

from ..recordings import form_files, tuning_files

_DEPLOY = Path(__file__).parents[2] / "deploy"
KINDS = (*("csv", "text", "parquet", "xml", "json", "matlab", "tuning"), *("config", "machine"))
_NUMBERED = """
[columns]
time_s = { column = "#1" }
torque_command_nm = { column = "#2" }
"""
WORDS = (
    *(b"", b"nan", b"inf", b"-inf", b"-1", b"0", b"1e308", b"1e-308", b"9" * 400, b"1_0", b"0x1"),
    *(b'""', b"''", b"[]", b"{}", b"true", b"null", b'"X"', b'"../.."', b"[[1.0]]", b"{ a = 1 }"),
    *(b"\xff\xfe", b"\0", b'"' * 3, b"[" * 3000, b"&a;", b"<!DOCTYPE a [", b"]]>", b"1,5", b";"),
    *(b"2026-01-01", b"tcp/127.0.0.1:0", b'"%s"', b"\xf0\x9f\x92\xa9", b"a" * 5000, b"\r\n", b"\t"),
)
_WORD = re.compile(rb"[A-Za-z0-9_.+\-]+")


def right_files() -> dict[str, Sequence[bytes]]:
    """Right contents by kind: the forms of a recording, a servo tuning, and files of settings."""
    configs = [_DEPLOY / "edge.toml", _DEPLOY / "drivers" / "simulated.toml"]
    machines = [_DEPLOY / f"{e}.toml" for e in ("machine", "commissioned", "emps", "cnc_mill")]
    csv = form_files.csv()
    return {
        "csv": [*csv, csv[0].decode().encode("utf-16")],
        "text": [form_files.headerless()],
        "parquet": form_files.parquets(),
        "xml": form_files.xmls(),
        "json": form_files.jsons(),
        "matlab": form_files.matlabs(),
        "tuning": _tunings(),
        "config": [path.read_bytes() for path in configs],
        "machine": [path.read_bytes() for path in machines],
    }


def _tunings() -> list[bytes]:
    """A mass that swings on another, as a tuning and as a measurement."""
    frequency = np.geomspace(1.0, 500.0, 60)
    s = 2j * np.pi * frequency
    response = ((s / 250) ** 2 + s / 4000 + 1) / ((s / 350) ** 2 + s / 5000 + 1) / (0.1 * s)
    power = np.ones(60)
    spectra = [np.abs(response) ** 2, 0.999 * np.abs(response) ** 2 / response, power]
    whole = tuning_files.tuning(frequency, response, 0.99 * power, {"m_dTotalInertia": 0.1})
    return [whole.encode("latin-1"), tuning_files.measurement(frequency, spectra).encode("latin-1")]


def spoiled(content: bytes, chance: random.Random) -> bytes:
    """The content with another word or other bytes in one to four places, short or long."""
    for _ in range(chance.randrange(1, 5)):
        start = chance.randrange(len(content) + 1)
        end = start + chance.choice((0, 1, chance.randrange(200), len(content)))
        word = _WORD.search(content, start)
        if word and chance.random() < 0.5:
            start, end = word.span()
        old = content[start:end]
        new = (b"", chance.choice(WORDS), chance.randbytes(len(old) or 8), bytes(64), old * 50)
        content = content[:start] + chance.choice(new)[:50_000] + content[end:]
    return content


def command_on(kind: str, content: bytes, folder: Path) -> list[str]:
    """Write a content; the arguments of the command that reads it."""
    if kind in ("config", "machine"):
        (folder / "edge.toml").write_text('[[axes]]\nname = "X"\nmachine = "spoiled.toml"\n')
        (folder / ("edge.toml" if kind == "config" else "spoiled.toml")).write_bytes(content)
        return ["check-config", str(folder / "edge.toml")]
    path = folder / f"spoiled.{kind}"
    path.write_bytes(content)
    if kind == "tuning":
        return ["fingerprint", str(path), "--out", str(folder / "out")]
    arguments = ["convert", str(path), "--out", str(folder / "out.csv")]
    if kind == "text":
        numbered = folder / "numbered.toml"
        numbered.write_text((folder / "machine.toml").read_text() + _NUMBERED)
        arguments += ["--machine", str(numbered)]
    return arguments


def answer_to(arguments: Sequence[str]) -> str:
    """Fault of the answer of a command; empty for success, "refused" for one line and status 2.

    `check-config` tells every mistake on a line of its own.
    """
    said, out = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        status = main(arguments)
    lines = said.getvalue().splitlines()
    if status == DONE:
        return ""
    told = all(line.startswith("edge-service: ") for line in lines)
    is_clear = told and (len(lines) == 1 or (arguments[0] == "check-config" and lines))
    return "refused" if status == BAD_INPUT and is_clear else f"status {status}: {lines[:3]}"
