"""A diagnosis as JSON (diagnosis/1) and as a machine file with the effects that it accepted."""

import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from ...diagnose.localisation.places import Place
from ...diagnose.pipeline import Diagnosis, NamedEffect, Verdict
from ...diagnose.session.session import CHANNEL_UNITS
from ...diagnose.validation.replay import Replay
from ...diagnose.validation.shrink import Shrink
from ...messages.arrays import finite_or_none
from ...models.effects.registry import effects_where

SCHEMA = "diagnosis/1"


def to_document(
    found: Diagnosis, remarks: Sequence[str], unobservable: Mapping[str, str]
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
                "floor_source": each.floor_source,
                "tolerance": each.tolerance,
                "unit": each.unit,
                "replayed": _replayed(found.replay, name),
            }
            for name, each in found.gap.items()
        },
        "where": [_place(place) for place in found.where],
        "effects": [_effect(each, found.replay) for each in found.effects],
        "unexplained": {"share": found.unexplained, "nearest": found.nearest},
        "next_motion": found.next_motion,
        "where_after": [_place(place) for place in found.where_after],
        "waterfall": {
            name: [{"effect": effect, "rms": rms} for effect, rms in steps]
            for name, steps in found.waterfall.items()
        },
        "not_judged": list(unobservable),
        "not_judged_reasons": dict(unobservable),
        "reasons": [],
        "withheld": withheld(found),
        "remarks": list(remarks),
        "caveats": list(found.caveats),
        "replay": {"possible": not found.replay.problem, "reason": found.replay.problem or None},
        "suspects": {
            name: {"structure": finite_or_none(each)} for name, each in found.suspects.items()
        },
    }


def withheld(found: Diagnosis) -> list[str]:
    """Names of the effects that are a fault, or may be one: no model is to learn them."""
    faults = effects_where(lambda effect: effect.is_fault)
    return [each.name for each in found.effects if faults & {each.name, *each.tied}]


def learnable(found: Diagnosis) -> list[NamedEffect]:
    """Effects that the model may learn."""
    kept_out = withheld(found)
    return [each for each in found.effects if each.name not in kept_out]


def bad_data_document(
    reasons: Sequence[str], gap: Mapping[str, float], remarks: Sequence[str]
) -> dict[str, Any]:
    """The document where the data do not allow a diagnosis."""
    return {
        "schema": SCHEMA,
        "verdict": Verdict.BAD_DATA.value,
        "gap": {
            name: {"before": rms, "after": rms, "noise_floor": None, "unit": CHANNEL_UNITS[name]}
            for name, rms in gap.items()
        },
        "where": [],
        "effects": [],
        "unexplained": {"share": None, "nearest": None},
        "next_motion": None,
        "where_after": [],
        "waterfall": {},
        "not_judged": [],
        "not_judged_reasons": {},
        "reasons": list(reasons),
        "withheld": [],
        "remarks": list(remarks),
        "caveats": [],
        "replay": {"possible": False, "reason": "bad data"},
        "suspects": {},
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


def _replayed(replay: Replay, channel: str) -> dict[str, Any] | None:
    """Measured less simulated in a channel, held-out blocks; null where nothing was replayed."""
    each = replay.gap.get(channel)
    if each is None:
        return None
    return {
        "before": each.before_rms,
        "after": each.after_rms,
        "unexplained": each.unexplained_rms,
        "shrink": _shrink(each.shrink),
    }


def _shrink(each: Shrink) -> dict[str, float]:
    return {"estimate": each.estimate, "low": each.low, "high": each.high}


def _effect(each: NamedEffect, replay: Replay) -> dict[str, Any]:
    replayed = replay.effects.get(each.name)
    return {
        "name": each.name,
        "channel": each.channel,
        "probability": each.probability,
        "class": list(each.tied),
        "shrink": _shrink(each.shrink),
        "replay": None if replayed is None else _shrink(replayed),
        "parameters": {
            name: {
                "value": value.value,
                "low": finite_or_none(value.low),
                "high": finite_or_none(value.high),
                "unit": value.unit,
            }
            for name, value in each.parameters.items()
        },
        "entries": [dict(values) for values in each.entries],
    }


def _inline(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {float(value)!r}" for name, value in values.items())


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
