"""Other JSON by a map of members."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.mqtt.mapped import MappedStream
from drivers.mqtt.streams import Lateness, MessageError, Order
from edge_service.messages.samples import Quality

from ..bench import MACHINE
from .bench import config_of

TORQUE, ANGLE, HEAT = "torque_command_nm", "motor_angle_rad", "temperature_c"


def stream_of(time: str | None = "t", **changes: Any) -> MappedStream:
    signals = changes.pop(
        "signals",
        [
            {"channel": TORQUE, "member": "d.torque", "unit": "mN m"},
            {"channel": ANGLE, "member": "d.angle", "unit": "deg", "scale": -1.0},
            {"channel": HEAT, "member": "heat", "low": 0.0, "high": 100.0},
        ],
    )
    config = config_of(1, signals=signals, time=time, **changes)
    return MappedStream(config, MACHINE, clock=lambda: 1000.0)


def test_one_sample_per_message_with_unit_and_sign() -> None:
    message = {"t": 5.0, "d": {"torque": 1500, "angle": 180.0}, "heat": 21.5}
    (frame,) = stream_of().frames(message)
    assert (frame.time_s.tolist(), frame.channels[TORQUE].tolist()) == ([5.0], [1.5])
    assert frame.channels[ANGLE].tolist() == pytest.approx([-np.pi])
    assert not frame.quality


def test_lists_are_a_sample_each_and_a_slower_signal_stands_in_the_first() -> None:
    message = {"t": 5000, "d": {"torque": [1, 2, 3], "angle": [0, 0, 0]}, "heat": 500}
    (frame,) = stream_of(time_unit="ms", period_s=0.01).frames(message)
    assert frame.time_s.tolist() == pytest.approx([5.0, 5.01, 5.02])
    assert frame.channels[TORQUE].tolist() == pytest.approx([0.001, 0.002, 0.003])
    assert frame.quality[HEAT].tolist() == [Quality.OUT_OF_RANGE, 0, 0]
    assert np.isnan(frame.channels[HEAT]).all()


def test_members_of_elements_and_an_element_by_its_member() -> None:
    signals = [
        {"channel": TORQUE, "member": "vals.id=101.val"},
        {"channel": ANGLE, "member": "vals.id=102.val"},
    ]
    stamp = "2026-01-31T12:00:00.250Z"
    vals = [{"id": "101", "val": 1.5, "ts": stamp}, {"id": "102", "val": 2.5, "ts": stamp}]
    stream = stream_of("vals.id=101.ts", time_unit="iso", signals=signals)
    (frame,) = stream.frames({"seq": 1, "vals": vals})
    assert frame.time_s[0] % 1.0 == pytest.approx(0.25)
    assert (frame.channels[TORQUE][0], frame.channels[ANGLE][0]) == (1.5, 2.5)
    every = stream_of("s.*.t", signals=[{"channel": TORQUE, "member": "s.*.v"}])
    (frame,) = every.frames({"s": [{"t": 1, "v": 10}, {"t": 2, "v": 20}]})
    assert (frame.time_s.tolist(), frame.channels[TORQUE].tolist()) == ([1.0, 2.0], [10.0, 20.0])


def test_without_a_time_that_of_arrival_stands_in_and_is_doubted() -> None:
    (frame,) = stream_of(time=None, period_s=0.5).frames(
        {"d": {"torque": [1, 2], "angle": [1, 2]}, "heat": 20}
    )
    assert frame.time_s.tolist() == [999.5, 1000.0]
    assert (frame.quality[TORQUE] == Quality.NO_SOURCE_TIME).all()


def test_what_comes_again_or_late_is_dropped_and_counted() -> None:
    stream = stream_of()
    sent = [{"t": t, "d": {"torque": t, "angle": t}, "heat": 20} for t in (1, 3, 3, 2, 4)]
    times_s = [float(f.time_s[0]) for each in sent for f in stream.frames(each)]
    assert times_s == [1.0, 3.0, 4.0]
    assert stream.counters == {"repeated_samples": 1, "late_samples": 1, "restarts": 0}


def kept(order: Order, *times_s: float) -> list[bool]:
    return [bool(order.keep(np.array([t]), np.array([[t, n]]))[0]) for n, t in enumerate(times_s)]


def test_an_older_time_is_dropped_until_nothing_else_has_come_for_a_second() -> None:
    now_s = [0.0]
    order = Order(are_times=True, clock=lambda: now_s[0])
    assert kept(order, 100.0, 13.6, 100.1, 100.2) == [True, False, True, True]
    for now_s[0] in (1.0, 1.25, 1.5, 1.75, 2.0, 2.25):
        assert kept(order, 70.0 + now_s[0]) == [now_s[0] >= 2.0]
    assert order.counts == {"repeated_samples": 0, "late_samples": 5, "restarts": 1}


def test_a_clock_that_stands_gives_one_sample() -> None:
    order = Order(are_times=True, clock=iter(range(100)).__next__)
    assert kept(order, *[100.0] * 30) == [True] + [False] * 29


def test_what_was_kept_on_the_way_is_late_and_another_clock_is_not() -> None:
    now_s = [0.0]
    lateness = Lateness(lambda: now_s[0])
    sent_s, arrives_s = 0.1 * np.arange(200), 0.1 * np.arange(200)
    arrives_s[50:100] = 10.0 + 0.001 * np.arange(50)  # held for five seconds, then all at once
    lags_s = []
    for now_s[0], time_s in zip(arrives_s.tolist(), sent_s, strict=True):
        lags_s.append(lateness.lag_s(7e8 + time_s, run=0))
    np.testing.assert_allclose(lags_s, arrives_s - sent_s, atol=0.4)
    assert lateness.lag_s(7e8, run=1) == 0.0
    for now_s[0] in 20.0 + 0.1 * np.arange(300):  # and has been put back by 5 s, within a run
        lag_s = lateness.lag_s(7e8 + now_s[0] - 25.0, run=1)
    assert lag_s < 0.1


STRANGE: dict[str, dict[str, Any]] = {
    "none of the members": {"t": 1.0},
    "lists of different length": {"t": 1, "d": {"torque": [1, 2], "angle": [1, 2, 3]}},
    "no time": {"d": {"torque": 1, "angle": 1}},
    "a time that is none": {"t": "soon", "d": {"torque": 1, "angle": 1}},
    "an endless time": {"t": 1e999, "d": {"torque": 1, "angle": 1}},
    "milliseconds since 1970": {"t": 1.8e12, "d": {"torque": 1, "angle": 1}},
    "one time for many": {"t": 1, "d": {"torque": [1, 2], "angle": [1, 2]}},
    "a list where a name is": {"t": 1, "d": [1, 2]},
    "too many samples": {"t": 1, "d": {"torque": [0] * 100_001}},
}


@pytest.mark.parametrize("name", STRANGE)
def test_a_strange_message_is_skipped(name: str) -> None:
    with pytest.raises(MessageError):
        stream_of().frames(STRANGE[name])


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "a place that is none": ({"signals": [{"channel": TORQUE, "member": "a..b"}]}, "member"),
    "a time without a map": ({"time": "t"}, "time: is for a map"),
    "a period without a map": ({"period_s": 1.0}, "period_s: is for a map"),
    "a channel twice": ({"signals": [{"channel": TORQUE, "member": "a"}] * 2}, "more than once"),
    "only a slow channel": ({"signals": [{"channel": HEAT, "member": "a"}]}, "expected one of"),
    "half a wildcard": ({"topic": "a/b+"}, "whole levels"),
    "a wildcard in the middle": ({"topic": "a/#/b"}, "whole levels"),
    "a password in the open": (
        {"url": "mqtt://u@10.0.0.1", "password": "p"},
        "url: a user needs mqtts://",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_setting_names_its_key(name: str) -> None:
    changes, said = WRONG[name]
    with pytest.raises(ValidationError, match=said):
        config_of(1, **changes)
