"""A diagnosis as JSON (diagnosis/1) and as a machine file with the effects that it accepted."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from ..diagnose.diagnosis import Diagnosis, NamedEffect, Verdict
from ..diagnose.where import Place

SCHEMA = "diagnosis/1"


def to_document(
    found: Diagnosis, remarks: Sequence[str], not_judged: Sequence[str]
) -> dict[str, Any]:
    """The document of a diagnosis."""
    return {
        "schema": SCHEMA,
        "verdict": found.verdict.value,
        "gap": {
            name: {
                "before": each.before,
                "after": each.after,
                "noise_floor": each.noise_floor,
                "unit": each.unit,
            }
            for name, each in found.gap.items()
        },
        "where": [_place(place) for place in found.where],
        "effects": [_effect(each) for each in found.effects],
        "unexplained": {"share": found.unexplained, "nearest": found.impostor},
        "next_motion": found.next_motion,
        "where_after": [_place(place) for place in found.where_after],
        "waterfall": {
            name: [{"effect": effect, "rms": rms} for effect, rms in steps]
            for name, steps in found.waterfall.items()
        },
        "not_judged": list(not_judged),
        "reasons": [],
        "remarks": list(remarks),
    }


def bad_data_document(
    reasons: Sequence[str], gap: Mapping[str, float], remarks: Sequence[str]
) -> dict[str, Any]:
    """The document where the data do not allow a diagnosis."""
    units = {"torque_nm": "N m", "transmission_m": "m"}
    return {
        "schema": SCHEMA,
        "verdict": Verdict.BAD_DATA.value,
        "gap": {
            name: {"before": rms, "after": rms, "noise_floor": None, "unit": units[name]}
            for name, rms in gap.items()
        },
        "where": [],
        "effects": [],
        "unexplained": {"share": None, "nearest": None},
        "next_motion": None,
        "where_after": [],
        "waterfall": {},
        "not_judged": [],
        "reasons": list(reasons),
        "remarks": list(remarks),
    }


def _place(place: Place) -> dict[str, Any]:
    return {
        "channel": place.channel,
        "variable": place.variable,
        "from": place.low,
        "to": place.high,
        "unit": place.unit,
        "share": place.share,
        "energy_share": place.energy,
    }


def _effect(each: NamedEffect) -> dict[str, Any]:
    return {
        "name": each.name,
        "channel": each.channel,
        "probability": each.probability,
        "class": list(each.tied),
        "shrink": {
            "estimate": each.shrink.estimate,
            "low": each.shrink.low,
            "high": each.shrink.high,
        },
        "parameters": {
            name: {
                "value": value.value,
                "low": _finite(value.low),
                "high": _finite(value.high),
                "unit": value.unit,
            }
            for name, value in each.parameters.items()
        },
        "entries": [dict(values) for values in each.entries],
    }


def _inline(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {float(value)!r}" for name, value in values.items())


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def augmented_toml(machine_text: str, effects: Sequence[NamedEffect]) -> str:
    """The machine file with the accepted effects behind those that it has.

    Raises:
        ValueError: the file writes its effects as one value, to which nothing can be appended.
    """
    blocks = [
        f'\n[[effects]]\nname = "{each.name}"\nparameters = {{ {_inline(values)} }}\n'
        for each in effects
        for values in each.entries
    ]
    text = machine_text.rstrip("\n") + "\n" + "".join(blocks)
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(
            f"effects: cannot be appended to; write them as [[effects]] ({error})"
        ) from error
    return text
