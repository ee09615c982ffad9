"""MCAP: rows come back through the format's own reader."""

import json
from pathlib import Path

import numpy as np
import pytest

from edge_service.messages.samples import ANGLE, TORQUE, SampleFrame
from edge_service.recordings.columns import TraceError
from edge_service.recordings.writer import TraceWriter

mcap_reader = pytest.importorskip("mcap.reader", reason="the extra 'mcap' is not installed")

TORQUES = np.array([0.1, np.nan, 1e-300, -2.5])
ANGLES = np.array([1.0, np.pi, 2.0 / 3.0, np.inf])


def _write(path: Path, time_s: list[float]) -> Path:
    with TraceWriter(path, [TORQUE, ANGLE]) as writer:
        writer.write(SampleFrame(np.array(time_s), {TORQUE: TORQUES, ANGLE: ANGLES}))
    return path


def test_every_value_comes_back_at_its_time(tmp_path: Path) -> None:
    path = _write(tmp_path / "trace.mcap", [0.0, 0.002, 0.004, 12.5])
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file, validate_crcs=True)
        messages = list(reader.iter_messages())
        (schema,) = reader.get_summary().schemas.values()
    assert [message.log_time for _, _, message in messages] == [
        0,
        2_000_000,
        4_000_000,
        12_500_000_000,
    ]
    assert {channel.topic for _, channel, _ in messages} == {"axis/samples"}
    assert {channel.message_encoding for _, channel, _ in messages} == {"json"}
    rows = [json.loads(message.data) for _, _, message in messages]
    assert [row["time_s"] for row in rows] == [0.0, 0.002, 0.004, 12.5]
    assert [row[TORQUE] for row in rows] == [0.1, None, 1e-300, -2.5]
    assert [row[ANGLE] for row in rows] == [1.0, np.pi, 2.0 / 3.0, None]
    assert schema.encoding == "jsonschema"
    assert set(json.loads(schema.data)["properties"]) == {"time_s", TORQUE, ANGLE}


def test_log_times_count_from_the_first_row_where_time_is_negative(tmp_path: Path) -> None:
    path = _write(tmp_path / "trace.mcap", [-0.5, 0.0, 0.5, 1.0])
    with path.open("rb") as file:
        reader = mcap_reader.make_reader(file)
        times = [message.log_time for _, _, message in reader.iter_messages()]
        (metadata,) = list(reader.iter_metadata())
    assert times == [0, 500_000_000, 1_000_000_000, 1_500_000_000]
    assert metadata.metadata == {"log_time_zero_s": "-0.5"}


@pytest.mark.parametrize("time_s", [[0.0, 1.0, -1.0, 2.0], [0.0, 1e12, 2.0, 3.0]])
def test_a_time_that_cannot_be_a_log_time(tmp_path: Path, time_s: list[float]) -> None:
    with pytest.raises(TraceError, match="cannot be a log time of MCAP"):
        _write(tmp_path / "trace.mcap", time_s)
    assert list(tmp_path.iterdir()) == []
