"""A fingerprint as JSON and back (schema "fingerprint/1")."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..messages.arrays import finite_or_none
from ..regression.interval_estimate import IntervalEstimate
from .fingerprint import AxisFingerprint
from .result import Curve, Section, Status

SCHEMA = "fingerprint/1"


class FingerprintError(Exception):
    """A fingerprint that cannot be made or read; the text is one line."""


def to_document(fingerprint: AxisFingerprint) -> dict[str, Any]:
    """JSON-able values; what is not finite is null."""
    return {
        "schema": SCHEMA,
        "machine": fingerprint.machine,
        "sources": list(fingerprint.sources),
        "sections": {
            name: _section_document(section) for name, section in fingerprint.sections.items()
        },
    }


def read_fingerprint(path: Path) -> AxisFingerprint:
    """A stored fingerprint.

    Raises:
        FingerprintError: there is none, or it is no fingerprint of this schema.
    """
    try:
        document = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise FingerprintError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise FingerprintError(f"{path}: not JSON ({error}); expected {SCHEMA}") from error
    found = document.get("schema") if isinstance(document, dict) else None
    if found != SCHEMA:
        raise FingerprintError(f"{path}: schema {found!r}, expected {SCHEMA!r}")
    try:
        return _from_document(document)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FingerprintError(f"{path}: not a complete {SCHEMA} document ({error!r})") from error


def _section_document(section: Section) -> dict[str, Any]:
    return {
        "status": section.status.value,
        "reason": section.reason,
        "motion": section.motion,
        "figures": {
            name: {
                "value": finite_or_none(figure.value),
                "low": finite_or_none(figure.low),
                "high": finite_or_none(figure.high),
                "unit": figure.unit,
                "n_effective": finite_or_none(figure.n_effective),
                "note": figure.note,
            }
            for name, figure in section.figures.items()
        },
        "curves": [
            {
                "name": curve.name,
                "x": [finite_or_none(float(value)) for value in curve.x],
                "y": [finite_or_none(float(value)) for value in curve.y],
                "x_label": curve.x_label,
                "y_label": curve.y_label,
            }
            for curve in section.curves
        ],
    }


def _from_document(document: Mapping[str, Any]) -> AxisFingerprint:
    sections = {
        str(name): Section(
            Status(content["status"]),
            str(content["reason"]),
            str(content["motion"]),
            {str(key): _figure(figure) for key, figure in content["figures"].items()},
            tuple(_curve(curve) for curve in content["curves"]),
        )
        for name, content in document["sections"].items()
    }
    sources = tuple(str(source) for source in document["sources"])
    return AxisFingerprint(str(document["machine"]), sources, sections)


def _figure(figure: Mapping[str, Any]) -> IntervalEstimate:
    return IntervalEstimate(
        _number(figure["value"], math.nan),
        _number(figure["low"], -math.inf),
        _number(figure["high"], math.inf),
        str(figure["unit"]),
        _number(figure["n_effective"], math.inf),
        str(figure["note"]),
    )


def _curve(curve: Mapping[str, Any]) -> Curve:
    x, y = (
        np.array([_number(value, math.nan) for value in curve[key]], dtype=np.float64)
        for key in ("x", "y")
    )
    return Curve(str(curve["name"]), x, y, str(curve["x_label"]), str(curve["y_label"]))


def _number(value: float | None, missing: float) -> float:
    return missing if value is None else float(value)
