"""Live blocks of the capture: as from a file, and lost, repeated, late or hostile ones."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base import DriverMisconfiguredError
from drivers.mqtt.streams import MOST_LATE, EdgeStream, MessageError, decode_object
from drivers.mqtt.stub import BLOCK_ROWS, EdgeWriter
from drivers.stub import StubAxis
from edge_service.messages.samples import Quality, SampleFrame
from edge_service.recordings.reader import read_trace
from edge_service.recordings.sinumerik.edge import RESTART_GAP_S
from edge_service.recordings.sinumerik.signals import ControllerAxis

from ...recordings.form_files import EDGE_NAMES, edge_json
from ..bench import CONTEXT, counting_source, whole
from .bench import config_of

AXIS = ControllerAxis(number=1, lead_m=0.01)
BLOCK = 10
ROWS = 300


def recorded(rows: int = ROWS, first: int = 5000) -> np.ndarray:
    """Count, two positions in mm and a torque in N m; no two rows alike."""
    number = np.arange(rows, dtype=np.float64)
    return np.column_stack([first + number, 0.1 * number, 0.1 * number + 0.01, np.sin(number)])


def messages(rows: np.ndarray, block: int = BLOCK, **more: Any) -> list[dict[str, Any]]:
    recording = json.loads(edge_json(rows.tolist(), block=block, events=(), **more))
    blocks = [each for each in recording["Payload"] if "HFData" in each]
    return [{"Header": recording["Header"], "Payload": [each]} for each in blocks]


def stream_of(axis: ControllerAxis = AXIS) -> EdgeStream:
    return EdgeStream(Path("broker/topic"), {}, axis)


def heard(stream: EdgeStream, sent: list[dict[str, Any]]) -> SampleFrame:
    return whole([frame for each in sent for frame in stream.frames(each)])


def test_samples_are_those_that_the_file_reader_gives(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(edge_json(recorded().tolist()))
    expected, stream = read_trace(path, axis=AXIS), stream_of()
    got = heard(stream, messages(recorded()))
    np.testing.assert_allclose(got.time_s, expected.time_s, atol=1e-12)
    assert set(got.channels) == set(expected.channels)
    for name, values in expected.channels.items():
        np.testing.assert_array_equal(got.channels[name], values)
    assert stream.counters["lost_samples"] == stream.counters["gaps"] == 0


@settings(deadline=None, max_examples=60)
@given(
    lost=st.sets(st.integers(1, ROWS // BLOCK - 2), max_size=8),
    twice=st.lists(st.integers(0, ROWS // BLOCK - 1), max_size=8),
)
def test_what_is_lost_and_repeated_is_counted_and_nothing_is_invented(
    lost: set[int], twice: list[int]
) -> None:
    rows, sent = recorded(), messages(recorded())
    order = [each for number in range(len(sent)) for each in [number] * (1 + twice.count(number))]
    order = [number for number in order if number not in lost]
    stream = stream_of()
    got = heard(stream, [sent[number] for number in order])
    kept = np.array([row // BLOCK not in lost for row in range(ROWS)])
    np.testing.assert_allclose(got.time_s, 0.002 * (rows[kept, 0] - 5000), atol=1e-9)
    np.testing.assert_array_equal(got.channels["torque_command_nm"], rows[kept, 3])
    counters = stream.counters
    assert counters["lost_samples"] == BLOCK * len(lost)
    assert counters["repeated_samples"] == BLOCK * (len(order) - len(set(order)))
    assert counters["restarts"] == counters["late_samples"] == 0
    marked = got.quality["torque_command_nm"] == Quality.OVERFLOW
    np.testing.assert_array_equal(marked, np.diff(rows[kept, 0], prepend=4999) > 1)


@pytest.mark.parametrize("first", [5000, 1, 5155])
def test_a_count_that_begins_anew_is_a_new_run(first: int) -> None:
    sent = [*messages(recorded()), *messages(recorded(first=first)[:, [0, 3, 1, 2]])]
    stream = stream_of()
    got = heard(stream, sent)
    steps_s = np.diff(got.time_s)
    assert len(got) == 2 * ROWS
    assert np.count_nonzero(np.isclose(steps_s, RESTART_GAP_S)) == 1
    assert stream.counters["restarts"] == 1
    assert stream.counters["lost_samples"] == stream.counters["repeated_samples"] == 0


@pytest.mark.parametrize("rate_hz", [400.0, 1000.0, 8000.0])
async def test_what_the_stub_writes_comes_back_at_its_own_times(rate_hz: float) -> None:
    time_s = np.concatenate([np.arange(100), np.arange(400, 500)]) / rate_hz
    values = {"motor_angle_rad": time_s * 3.0, "torque_command_nm": np.full(200, 0.5)}
    source = counting_source()
    writer = EdgeWriter(StubAxis("X", config_of(1), CONTEXT, source))
    await source.aclose()
    writer.add(SampleFrame(time_s, values))
    sent = [decode_object(writer.message(numbers=True)) for _ in range(200 // BLOCK_ROWS)]
    stream = stream_of(ControllerAxis(lead_m=CONTEXT.machine.axis.lead_m))
    got = heard(stream, sent)
    np.testing.assert_allclose(got.time_s, time_s, atol=1e-9)
    np.testing.assert_allclose(got.channels["motor_angle_rad"], values["motor_angle_rad"])
    assert stream.counters["lost_samples"] == 300


def test_a_new_header_is_a_new_run_and_changing_remarks_in_it_are_none() -> None:
    first, second = messages(recorded()), messages(recorded(), cycle_ms=4)
    for number, each in enumerate(first):
        each["Header"]["Initial"] = {"HFTimestamp": number}
    stream = stream_of()
    got = heard(stream, [*first, *second])
    assert np.all(np.diff(got.time_s) > 0.0)
    assert got.time_s[ROWS] - got.time_s[ROWS - 1] == pytest.approx(RESTART_GAP_S)
    assert got.time_s[-1] - got.time_s[-2] == pytest.approx(0.004)


def test_several_axes_are_refused_with_their_list_unless_one_is_named() -> None:
    names = ["CYCLE", *EDGE_NAMES, "TORQUE|4"]
    rows = np.column_stack([recorded(), recorded()[:, 3]])
    sent = messages(rows, names=names)
    with pytest.raises(DriverMisconfiguredError, match=r"axes there are: 1 \(X1\), 4") as refused:
        stream_of(ControllerAxis(lead_m=0.01)).frames(sent[0])
    assert refused.value.key == "topic"
    got = heard(stream_of(ControllerAxis(number=4, lead_m=0.01)), sent)
    np.testing.assert_array_equal(got.channels["torque_command_nm"], rows[:, 4])


HEADER = messages(recorded())[0]["Header"]
HOSTILE: dict[str, bytes] = {
    "no JSON": b"\x00\xff{",
    "deep nesting": b"[" * 200_000,
    "no rows": b'{"HFData": {"a": 1}}',
    "a header that is none": b'{"Header": 5, "HFData": [[1, 2, 3, 4]]}',
    "a header without signals": b'{"Header": {"SignalListHFData": []}, "HFData": [[1]]}',
    "no count": json.dumps(
        {"Header": {"SignalListHFData": [{"Address": "TORQUE|1"}]}, "HFData": [[1]]}
    ).encode(),
    "words": json.dumps({"Header": HEADER, "HFData": [["a", "b", "c", "d"]] * 3}).encode(),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_message_is_skipped_before_and_after_good_ones(name: str) -> None:
    stream, sent = stream_of(), messages(recorded())
    for _ in range(2):
        with pytest.raises(MessageError) as skipped:
            assert not stream.frames(decode_object(HOSTILE[name]))
            raise MessageError("nothing came of it")
        assert "\n" not in str(skipped.value)
        assert len(heard(stream, sent)) == ROWS
        sent = messages(recorded(first=9000))


@pytest.mark.parametrize("count", ["NaN", "1e300", "-1e300", "null", "1e400", "-5", "1e9", "1e15"])
def test_a_wrong_count_disturbs_nothing_for_long(count: str) -> None:
    stream, sent = stream_of(), messages(recorded(3000))
    heard(stream, sent[:5])
    text = json.dumps(sent[5]).replace("[5050.0,", f"[{count},")
    assert count in text
    stream.frames(decode_object(text.encode()))
    got = heard(stream, sent[6:])
    lost = MOST_LATE if count in ("1e9", "1e15") else 0
    torques = got.channels["torque_command_nm"]
    np.testing.assert_array_equal(torques, recorded(3000)[3000 - len(torques) :, 3])
    assert len(torques) >= 3000 - 60 - lost
    assert (np.diff(got.time_s) > 0.0).all()
