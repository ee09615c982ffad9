"""Finding effects by name: every module of `library` is an entry; other packages may add some."""

import difflib
import importlib
import pkgutil
from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import entry_points

from ..machine import Machine
from . import library
from .effect import ActiveEffect, Effect, Kind, Term

ENTRY_POINT_GROUP = "edge_service.effects"
"""Entry points of other packages, each of which names an `Effect`."""


@cache
def effects() -> Mapping[str, Effect]:
    """All entries by name, in alphabetical order: the library's, and those of other packages.

    Raises ValueError: an entry of another package cannot be loaded, or bears the name of another.
    """
    found = {effect.name: effect for effect in _library()}
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        named = f"effect {entry.name}: {entry.value}"
        try:
            effect = entry.load()
        except (ImportError, AttributeError) as error:
            raise ValueError(f"{named} cannot be loaded: {error}") from error
        if not isinstance(effect, Effect):
            raise ValueError(f"{named} is not an Effect")
        if effect.name in found:
            raise ValueError(f"effect {effect.name}: {entry.value} uses the name of another effect")
        found[effect.name] = effect
    return dict(sorted(found.items()))


@cache
def _library() -> tuple[Effect, ...]:
    names = sorted(module.name for module in pkgutil.iter_modules(library.__path__))
    return tuple(importlib.import_module(f"{library.__name__}.{name}").EFFECT for name in names)


def effect_names() -> tuple[str, ...]:
    """Names of all effects, in alphabetical order."""
    return tuple(effects())


def get_effect(name: str) -> Effect:
    """The entry of a name. Raises ValueError: no effect has this name."""
    if (effect := effects().get(name)) is None:
        near = difflib.get_close_matches(name, effect_names(), n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"no effect {name!r}{hint}; there are {', '.join(effect_names())}")
    return effect


def effects_where(holds: Callable[[Effect], bool]) -> frozenset[str]:
    """Names of the effects of which something holds."""
    return frozenset(name for name, effect in effects().items() if holds(effect))


def error_of(term: Term) -> str:
    """Name of the effect that is an error of a constant of the baseline model."""
    return next(effect.name for effect in _library() if effect.term is term)


def disturbance() -> str:
    """Name of the effect that is a force on the table which nothing foretells."""
    return next(effect.name for effect in _library() if effect.kind is Kind.DISTURBANCE)


def fault() -> Effect:
    """The effect of the library that is a fault: loss of preload."""
    return next(effect for effect in _library() if effect.is_fault)


def active_effect(name: str, given: Mapping[str, float]) -> ActiveEffect:
    """An effect with checked values; what is not given is typical (see `Effect.complete`).

    Raises ValueError: unknown effect or parameter, or a value out of its bounds.
    """
    effect = get_effect(name)
    return ActiveEffect(effect, effect.complete(given))


def parse_effect(text: str, screw: Mapping[str, float] | None = None) -> ActiveEffect:
    """An effect as the command line writes it: NAME[:key=value,...].

    A loss of preload is one of `screw`, values by name, in what is not written.

    Raises ValueError: as `active_effect`, or a part that is no key=number.

    >>> parse_effect("backlash:width_m=4e-6").values
    {'width_m': 4e-06, 'friction_share': 1.0, 'viscous_share': 0.0}
    """
    name, _, rest = text.partition(":")
    given: dict[str, float] = {}
    for part in filter(None, rest.split(",")):
        key, _, number = part.partition("=")
        try:
            value = float(number)
        except ValueError:
            raise ValueError(f"effect {name}: expected key=number, got {part!r}") from None
        if key.strip() in given:
            raise ValueError(f"effect {name}: {key.strip()} is given twice")
        given[key.strip()] = value
    fresh = (screw or {}) if name.strip() == fault().name else {}
    return active_effect(name.strip(), {**fresh, **given})


def machine_effects(machine: Machine) -> tuple[ActiveEffect, ...]:
    """The effects that a machine file has already modelled.

    Raises ValueError: as `active_effect`.
    """
    return tuple(
        active_effect(each.name, {name: number.value for name, number in each.parameters.items()})
        for each in machine.effects
    )
