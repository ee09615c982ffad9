"""Latest answers about all axes, for outputs that show what holds now."""

from ...clock import now_ns
from ...config import EdgeConfig
from ...estimate.registry import AUTO
from ...health.axis_state import AxisState
from ...health.service_state import ServiceState
from ...health.state_settings import Keeping, StateSettings
from ...messages.answer import AxisAnswer
from ...messages.estimate import PreloadEstimate
from ...messages.header import Header
from ...messages.health import AxisHealth
from ...messages.topics import HEALTH, PRELOAD
from ...models.machine import Machine
from ..supervision.tasks import Tasks
from ..wiring.context import NodeContext
from ..wiring.stages import load_machines


def method_of(config: EdgeConfig, machine: Machine) -> str:
    """Method of an axis' estimator: `auto` takes the mixture where the axis is commissioned."""
    if config.estimator.method != AUTO:
        return config.estimator.method
    return "kf-imm" if machine.commissioned is None else "mixture"


def answer_of(state: ServiceState, config: EdgeConfig, axis: str, method: str) -> AxisAnswer:
    """Answer about an axis from the state of the service."""
    at_ns, (warning, fault) = now_ns(), config.limits_percent(axis)
    reading, bounds = state.preload(axis, at_ns), state.limits(axis)
    return AxisAnswer(
        axis=axis,
        estimate=reading.estimate,
        measured_ns=reading.measured_ns,
        health=state.health(axis, at_ns),
        fresh_percent=None if bounds is None else bounds.fresh_percent,
        warning_of_fresh=warning,
        fault_of_fresh=fault,
        is_heard=reading.measured_ns is not None,
        method=method,
    )


class LatestAnswers:
    """Latest estimate and condition of each configured axis. Raises ConfigError."""

    def __init__(self, context: NodeContext) -> None:
        self._context, self._started_ns = context, now_ns()
        machines = load_machines(context.config)
        self._fresh = {axis: machine.fresh_preload_percent for axis, machine in machines.items()}
        self._methods = {axis: method_of(context.config, each) for axis, each in machines.items()}
        self._states = {
            axis: AxisState(axis, None, StateSettings(), Keeping()) for axis in machines
        }

    def follow(self, tasks: Tasks) -> None:
        """Listen from now on."""
        tasks.follow("preloads", self._context.subscribe(PRELOAD), self.take_estimate)
        tasks.follow("conditions", self._context.subscribe(HEALTH), self.take_health)

    def take_estimate(self, axis: str, header: Header, estimate: PreloadEstimate) -> None:
        """Take an estimate in; one that is older than the last is ignored."""
        state = self._states[axis]
        if state.preload_input.accept(header, now_ns()):
            state.estimate = estimate

    def take_health(self, axis: str, header: Header, health: AxisHealth) -> None:
        """Take a condition in; one that is older than the last is ignored."""
        state = self._states[axis]
        if state.health_input.accept(header, now_ns()):
            state.health = health

    def now(self) -> tuple[AxisAnswer, ...]:
        """Answers as they hold now, an axis each."""
        at_ns = now_ns()
        return tuple(self._answer(state, at_ns) for state in self._states.values())

    def _answer(self, state: AxisState, at_ns: int) -> AxisAnswer:
        header = state.preload_input.header
        warning, fault = self._context.config.limits_percent(state.axis)
        return AxisAnswer(
            axis=state.axis,
            estimate=state.readable(at_ns),
            measured_ns=None if header is None else header.source_time_ns,
            health=state.told(self._started_ns, at_ns),
            fresh_percent=self._fresh[state.axis],
            warning_of_fresh=warning,
            fault_of_fresh=fault,
            is_heard=not state.missing(at_ns),
            method=self._methods[state.axis],
            header=header,
        )
