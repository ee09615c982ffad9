"""A stub plays the samples of a recording, and refuses one that is not there."""

from pathlib import Path

import numpy as np
import pytest

from edge_service.config import ConfigError
from edge_service.nodes.stub_node import make_stub, stub_axis

from .conftest import config_of

CONFIG = config_of(
    "modbus",
    {
        "url": "modbus://127.0.0.1:1",
        "poll_groups": {"all": 0.02},
        "registers": [{"channel": "torque_command_nm", "address": 0}],
    },
)


async def test_a_stub_plays_the_samples_of_a_recording(tmp_path: Path) -> None:
    trace = tmp_path / "short.csv"
    time_s = np.arange(40) * 0.002
    rows = np.column_stack([time_s, np.sin(time_s), 3.0 * time_s])
    trace.write_text("time_s,torque_command_nm,motor_angle_rad\n")
    with trace.open("a") as file:
        np.savetxt(file, rows, delimiter=",")
    axis = stub_axis(CONFIG.axes[0], "healthy", trace, None)
    frames = [frame async for frame in axis.source]
    played = np.concatenate([frame.channels["torque_command_nm"] for frame in frames])
    np.testing.assert_allclose(played, rows[:, 1])


def test_a_recording_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--trace .*: no such file"):
        make_stub("modbus", CONFIG, None, "healthy", tmp_path / "none.csv")
