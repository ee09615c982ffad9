"""A condition monitor with a clock of its own, fed with estimates made by hand."""

from dataclasses import dataclass, field

import pytest

from edge_service.config_tables import AlarmsConfig
from edge_service.health.condition import ConditionMonitor, limits_of
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.event import AxisCondition, Event
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock

from ..messages.examples import estimate_of

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
FRESH_PERCENT = 10.0
STEP_S = 0.1


@dataclass
class Scene:
    """One axis: with a fresh preload of 10 %, WARNING is below 6 % and FAULT below 3 %."""

    settings: AlarmsConfig = field(default_factory=AlarmsConfig)
    fresh_percent: float | None = FRESH_PERCENT
    now_ns: int = START_NS
    boot_epoch: int = START_NS
    sequence: int = 0
    events: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.monitor = ConditionMonitor(
            "X", limits_of(self.settings, self.fresh_percent), self.now_ns
        )

    def header(self) -> Header:
        header = Header(self.sequence, self.boot_epoch, self.now_ns, self.now_ns)
        self.sequence += 1
        return header

    def estimate(
        self, percent: float | None, half_width: float = 0.1, steps: int = 1, **more: object
    ) -> None:
        """Let `steps` estimates of the same preload come, 0.1 s apart."""
        for _ in range(steps):
            estimate = estimate_of(percent, half_width, **more)
            self.events += self.monitor.on_preload(self.header(), estimate, self.now_ns)
            self.wait(STEP_S)

    def silent(self, status: EstimateStatus, seconds: float) -> None:
        """Let estimates without a number come."""
        self.estimate(None, steps=round(seconds / STEP_S), status=status)

    def fault(self, fault: Fault) -> None:
        """Let one interval with data faults come."""
        values = {name: 0.0 for name in FEATURE_FIELDS if name != "fault"}
        block = FeatureBlock(fault=fault, **values)  # type: ignore[arg-type]
        self.events += self.monitor.on_feature(self.header(), block, self.now_ns)
        self.wait(STEP_S)

    def wait(self, seconds: float) -> None:
        """Let time pass without input."""
        self.now_ns += round(seconds * NS)
        self.events += self.monitor.tick(self.now_ns)

    @property
    def condition(self) -> AxisCondition:
        return self.monitor.health(self.now_ns).condition

    @property
    def reasons(self) -> tuple[str, ...]:
        return self.monitor.health(self.now_ns).reasons

    def changes(self, kind: str = "condition_changed") -> list[str]:
        return [str(event.data["to"]) for event in self.events if event.kind == kind]


@pytest.fixture
def scene() -> Scene:
    """A monitor that has heard nothing yet."""
    return Scene()
