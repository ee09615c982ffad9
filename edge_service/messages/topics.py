"""The one table of topics: payload, rate, staleness, limits and what is kept for late comers."""

from typing import Any

from .codec import JsonTopic, Topic
from .edge_block import FeatureTopic, SampleTopic, WaveformTopic
from .estimate import ImmEstimate, PreloadEstimate
from .event import Event
from .health import AxisHealth, Command, ComponentHealth, Outcome

_NEVER = float("inf")

RAW = SampleTopic("raw", "samples/1", 10.0, 2.0, 2_000_000, 5000.0)
FEAT = FeatureTopic("feat", "features/1", 10.0, 2.0, 20_000, 5000.0)
WAVE = WaveformTopic("wave", "waveform/1", 10.0, 2.0, 2_000_000, 5000.0, keeps_last=False)
PRELOAD = JsonTopic("preload", "preload/1", 10.0, 2.0, 20_000, 5000.0, PreloadEstimate)
IMM = JsonTopic("imm", "imm/1", 10.0, 2.0, 20_000, 5000.0, ImmEstimate)
HEALTH = JsonTopic("health", "health/1", 1.0, 5.0, 100_000, 200.0, AxisHealth, cached=600)
EVENT = JsonTopic("event", "event/1", 0.0, _NEVER, 20_000, 100.0, Event)
STATUS = JsonTopic("status", "status/1", 1.0, 5.0, 20_000, 50.0, ComponentHealth)
COMMAND = JsonTopic(
    *("command", "command/1", 0.0, _NEVER, 20_000, 20.0, Command),
    strict=False,  # as people's programs may send it
    keeps_last=False,
)
OUTCOME = JsonTopic("outcome", "outcome/1", 0.0, _NEVER, 20_000, 20.0, Outcome, keeps_last=False)
"""On its key a command is asked as a question, and answered."""

TOPICS: dict[str, Topic[Any]] = {
    topic.name: topic
    for topic in (RAW, FEAT, PRELOAD, IMM, HEALTH, EVENT, COMMAND, STATUS, WAVE, OUTCOME)
}
