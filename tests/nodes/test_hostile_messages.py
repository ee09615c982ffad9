"""Whatever passes the codecs: no reader fails, and no other axis is shown otherwise."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from edge_service.config import EstimatorConfig, load_machine
from edge_service.config_tables import AlarmsConfig
from edge_service.downsample.vibration import AxisVibration
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.condition import limits_of
from edge_service.health.service_state import ServiceState
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.http_api.routes.service import service_answer
from edge_service.messages.codec import CodecError, Header
from edge_service.messages.topics import EVENT, FEAT, HEALTH, PRELOAD, TOPICS
from edge_service.nodes.downsample_node import source_time_ns
from edge_service.nodes.record_node import DisagreementRecorder
from edge_service.nodes.stages import make_downsampler, make_estimator

from ..messages.examples import HEADER, PAYLOADS
from ..messages.hostile import hostile
from .conftest import estimated

MACHINE = load_machine(Path(__file__).parents[2] / "deploy" / "commissioned.toml")
GEOMETRY = ScrewGeometry(MACHINE.transmission_ratio_m_per_rad, MACHINE.axis.stroke_m)
FACTS = ("X", MACHINE.fresh_preload_percent, GEOMETRY)
START_NS = HEADER.source_time_ns
ANSWERS = (
    lambda state, axis, now: state.preload(axis, now),
    lambda state, axis, now: state.health(axis, now),
)


class Readers:
    """Everything that stands behind the codecs, for the axes X and Y."""

    def __init__(self, folder: Path) -> None:
        self.state = ServiceState({"X": limits_of(AlarmsConfig(), 10.0), "Y": None}, START_NS)
        self.monitor = AxisMonitor(*FACTS, AlarmsConfig(), START_NS)
        self.downsampler = make_downsampler(MACHINE)
        self.axis = estimated(lambda: make_estimator(EstimatorConfig(), MACHINE))
        self.vibration = AxisVibration({"screw": 1.0}, {"low": (10.0, 1000.0)})
        self.recorder = DisagreementRecorder(folder / "recordings", lambda *_: None)
        self.take: dict[str, Callable[[str, Header, Any], None]] = {
            "raw": self.on_samples,
            "feat": self.on_features,
            "preload": self.on_preload,
            "imm": lambda *opinion: self.state.on_opinion(*opinion, START_NS),
            "health": lambda _, *health: self.state.on_health(*health, START_NS),
            "event": self.on_event,
            "command": self.on_command,
            "status": self.on_report,
            "wave": self.on_wave,
            "outcome": lambda *_: None,
        }

    def on_samples(self, axis: str, header: Header, frame: Any) -> None:
        for block in self.downsampler.push(frame):
            told = replace(block, vibration=self.vibration.take())
            FEAT.encode(axis, Header(0, 0, source_time_ns(header, frame, block, 0), 0), told)
        self.vibration.follow(frame)
        self.recorder.follow(axis, frame)

    def on_features(self, axis: str, header: Header, block: Any) -> None:
        PRELOAD.encode(axis, header, self.axis.take(header, block))
        self.tell(self.monitor.on_feature(header, block, START_NS))
        self.state.on_feature(axis, header, block)

    def on_preload(self, axis: str, header: Header, estimate: Any) -> None:
        self.tell(self.monitor.on_preload(header, estimate, START_NS))
        self.monitor.take_trend(self.monitor.trend_work()(), START_NS)
        self.state.on_preload(axis, header, estimate, START_NS)

    def on_event(self, _axis: str, _header: Header, event: Any) -> None:
        if self.state.concerns(event):
            for logged in self.state.events.add((event,), START_NS):
                self.state.readers.put_event(logged)
        self.recorder.note(event)

    def on_command(self, _axis: str, _header: Header, command: Any) -> None:
        if self.monitor.answered(command) is None:
            self.tell(self.monitor.obey(command, START_NS)[1])

    def on_report(self, _axis: str, _header: Header, report: Any) -> None:
        self.tell(self.monitor.on_component(report, START_NS))
        self.state.on_component(report, START_NS)

    def on_wave(self, _axis: str, _header: Header, wave: Any) -> None:
        self.vibration.push(wave)

    def tell(self, events: Any) -> None:
        for event in events:
            EVENT.decode(EVENT.encode("X", HEADER, event))

    def shown(self, axis: str) -> list[str]:
        answers = [answer(self.state, axis, START_NS) for answer in ANSWERS]
        return [answer and answer.model_dump_json() for answer in answers]

    def look(self) -> None:
        """Show and keep everything, as the service does."""
        self.tell(self.monitor.tick(START_NS))
        HEALTH.decode(HEALTH.encode("X", HEADER, self.monitor.health(START_NS)))
        json.dumps(self.monitor.snapshot(), allow_nan=False)
        self.shown("X")
        service_answer(self.state, START_NS, []).model_dump_json()


def test_every_topic_has_its_readers(tmp_path: Path) -> None:
    assert Readers(tmp_path).take.keys() == TOPICS.keys()


@pytest.mark.slow
@pytest.mark.smoke
@given(messages=st.lists(hostile(), min_size=1, max_size=12))
@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_no_reader_fails_and_no_other_axis_is_shown_otherwise(
    tmp_path: Path, messages: list[tuple[str, bytes]]
) -> None:
    readers = Readers(tmp_path)
    for number, (name, payload) in enumerate(messages):
        try:
            axis, header, value = TOPICS[name].decode(payload)
        except CodecError:
            axis, header, value = "X", HEADER, PAYLOADS[name]  # a good one in between
        if axis not in ("X", "" if name == "status" else "X"):
            continue  # the subscriber refuses it on any key of X
        other = readers.shown("Y")
        readers.take[name]("X", header, value)
        readers.look()
        assert readers.shown("Y") == other, (number, name)
