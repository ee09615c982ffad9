"""Finding effects by name: every module of `library` is an entry."""

import difflib
import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache

from ..machine import Machine
from . import library
from .effect import ActiveEffect, Effect


@cache
def effects() -> Mapping[str, Effect]:
    """All entries by name, in alphabetical order."""
    names = [module.name for module in pkgutil.iter_modules(library.__path__)]
    modules = [importlib.import_module(f"{library.__name__}.{name}") for name in names]
    found: list[Effect] = [module.EFFECT for module in modules]
    return {effect.name: effect for effect in sorted(found, key=lambda effect: effect.name)}


def effect_names() -> tuple[str, ...]:
    """Names of all effects, in alphabetical order."""
    return tuple(effects())


def get_effect(name: str) -> Effect:
    """The entry of a name.

    Raises:
        ValueError: no effect has this name.
    """
    effect = effects().get(name)
    if effect is None:
        near = difflib.get_close_matches(name, effect_names(), n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"no effect {name!r}{hint}; there are {', '.join(effect_names())}")
    return effect


def active_effect(name: str, given: Mapping[str, float]) -> ActiveEffect:
    """An effect with checked values; what is not given is typical (see `Effect.complete`).

    Raises:
        ValueError: unknown effect or parameter, or a value out of its bounds.
    """
    effect = get_effect(name)
    return ActiveEffect(effect, effect.complete(given))


def parse_effect(text: str) -> ActiveEffect:
    """An effect as the command line writes it: NAME[:key=value,...].

    Raises:
        ValueError: as `active_effect`, or a part that is no key=number.

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
            raise ValueError(f"effect {name}: {key.strip()} is there twice")
        given[key.strip()] = value
    return active_effect(name.strip(), given)


def machine_effects(machine: Machine) -> tuple[ActiveEffect, ...]:
    """The effects that a machine file has already modelled.

    Raises:
        ValueError: as `active_effect`.
    """
    return tuple(
        active_effect(each.name, {name: number.value for name, number in each.parameters.items()})
        for each in machine.effects
    )
