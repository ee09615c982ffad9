"""Registry of the preload estimators: a new one is one file with a factory, and one line here."""

from collections.abc import Callable
from importlib import import_module
from typing import cast

from ..models.machine import Machine
from .interface import EstimatorOptions, PreloadEstimator, UnsuitableMachineError

Factory = Callable[[Machine, EstimatorOptions], PreloadEstimator]

AUTO = "auto"
"""Method that takes the first estimator of the registry that suits the machine."""
ESTIMATORS = {
    "mixture": "mixture.estimator:mixture",
    "kf-imm": "imm.estimator:kalman_imm",
    "sif-imm": "imm.estimator:sliding_innovation_imm",
}
"""Factory of each estimator by its method, `module:function`; loaded when it is asked for."""


def make_estimator(method: str, machine: Machine, options: EstimatorOptions) -> PreloadEstimator:
    """Estimator of one axis by its method.

    Raises:
        UnsuitableMachineError: the machine file lacks what the estimator needs.
    """
    if method != AUTO:
        return _factory(method)(machine, options)
    for name in ESTIMATORS:
        try:
            return _factory(name)(machine, options)
        except UnsuitableMachineError:
            continue
    raise UnsuitableMachineError("no estimator suits this machine file")


def _factory(method: str) -> Factory:
    module, _, name = ESTIMATORS[method].partition(":")
    return cast(Factory, getattr(import_module(f".{module}", __package__), name))
