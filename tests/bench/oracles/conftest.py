"""The machine and the plant against which the oracles are held."""

from ...models.conftest import machine, plant

__all__ = ["machine", "plant"]
