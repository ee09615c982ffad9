"""Interface common to all preload estimators, and their names.

A new one is one file with a factory, and one line of `ESTIMATORS`.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any, Literal, Protocol, cast

from ..messages.estimate import PreloadEstimate
from ..messages.features import FeatureBlock
from ..models.machine import Machine

Engine = Literal["compiled", "filterpy"]
"""Engine of the thesis' filter bank; other estimators have none."""


class UnsuitableMachineError(Exception):
    """Lack of the machine file that an estimator cannot do without; the text names it."""


class PreloadEstimator(Protocol):
    """Features in, estimates out; no clock, no I/O, no randomness.

    The same blocks in the same order give bit-equal estimates, live or replayed.
    """

    def update(self, block: FeatureBlock) -> None:
        """Take the next interval."""

    def estimate(self) -> PreloadEstimate:
        """Current estimate."""

    def interrupt(self) -> None:
        """Withdraw the number until motion comes: no data for longer than a number may stand."""

    def resume(self, stopped_s: float) -> None:
        """Continue after an unobserved stop, on a clock of its own.

        The axis has cooled and may have worked or worn meanwhile; it may even be another.
        """

    def reset(self) -> None:
        """Forget everything."""

    def snapshot(self) -> dict[str, Any]:
        """Whole state as JSON-able values; `restore` of it continues bit-equal."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot. ValueError if it is not of this estimator."""


AUTO = "auto"
"""Method that takes the first estimator of the registry that suits the machine."""
ESTIMATORS = {
    "mixture": "one_encoder:mixture",
    "kf-imm": "imm.estimator:kalman_imm",
    "sif-imm": "imm.estimator:sliding_innovation_imm",
}
"""Factory of each estimator by its method, `module:function`; loaded when it is asked for."""


def make_estimator(method: str, machine: Machine, engine: Engine = "compiled") -> PreloadEstimator:
    """Estimator of one axis by its method.

    Raises:
        UnsuitableMachineError: the machine file lacks what the estimator needs.
    """
    for name in tuple(ESTIMATORS) if method == AUTO else (method,):
        module, _, function = ESTIMATORS[name].partition(":")
        factory = getattr(import_module(f".{module}", __package__), function)
        try:
            return cast(Callable[[Machine, Engine], PreloadEstimator], factory)(machine, engine)
        except UnsuitableMachineError:
            if method != AUTO:
                raise
    raise UnsuitableMachineError("no estimator suits this machine file")
