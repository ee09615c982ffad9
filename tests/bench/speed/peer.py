"""A peer of the service as most people would write it: a message per sample, a bank at 10 Hz.

python -m tests.bench.speed.peer publish PORT AXES RATE_HZ
python -m tests.bench.speed.peer estimate PORT AXES

Paho, JSON and filterpy; it checks nothing, keeps nothing and answers nobody. Each prints how many
samples it has handled whenever it gets a line.
"""

import json
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from filterpy.kalman import IMMEstimator, KalmanFilter
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

MODES = 5
BLOCK = 100
CHANNELS = ("torque_command_nm", "motor_angle_rad", "table_position_m", "motor_speed_rad_s")


def connected(port: int) -> Client:
    client = Client(CallbackAPIVersion.VERSION2)
    client.connect("127.0.0.1", port)
    return client


def bank() -> IMMEstimator:
    """Five modes of two states and two measurements."""
    filters = []
    for mode in range(MODES):
        each = KalmanFilter(dim_x=2, dim_z=2)
        each.F = np.array([[1.0, 0.1], [0.0, 0.95]])
        each.H, each.R, each.Q = np.eye(2), np.eye(2) * 0.1, np.eye(2) * (0.01 + 0.01 * mode)
        filters.append(each)
    stay = np.full((MODES, MODES), 0.0025) + np.eye(MODES) * 0.9875
    return IMMEstimator(filters, np.full(MODES, 1.0 / MODES), stay)


class Estimating:
    """Banks of all axes, fed with means of blocks."""

    def __init__(self, axes: int) -> None:
        self.count = 0
        self._banks = [bank() for _ in range(axes)]
        self._sums = np.zeros((axes, 2))
        self._rows = [0] * axes

    def take(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        sample: dict[str, Any] = json.loads(message.payload)
        axis = int(sample["axis"])
        self._sums[axis] += sample["torque_command_nm"], sample["motor_speed_rad_s"]
        self._rows[axis] += 1
        self.count += 1
        if self._rows[axis] == BLOCK:
            self._banks[axis].predict()
            self._banks[axis].update(self._sums[axis] / BLOCK)
            self._sums[axis], self._rows[axis] = 0.0, 0


class Publishing:
    def __init__(self, client: Client, axes: int, rate_hz: float) -> None:
        self.count = 0
        self._client, self._axes, self._rate_hz = client, axes, rate_hz

    def run(self) -> None:
        """Publish for ever; what is late is made up for."""
        begun_s, tick = time.monotonic(), 0
        while True:
            time.sleep(max(0.0, begun_s + tick / self._rate_hz - time.monotonic()))
            for axis in range(self._axes):
                sample = {"axis": axis, "time_s": tick / self._rate_hz}
                sample |= {name: 0.1 * ((tick + k) % 97) for k, name in enumerate(CHANNELS)}
                self._client.publish(f"axis/{axis}", json.dumps(sample))
            self.count += self._axes
            tick += 1


def main(role: str, port: str, axes: str, rate_hz: str = "1000") -> None:
    """Be one half of the peer until the input ends."""
    client = connected(int(port))
    count: Callable[[], int]
    if role == "estimate":
        estimating = Estimating(int(axes))
        client.on_message = estimating.take
        client.subscribe("axis/+")
        count = lambda: estimating.count  # noqa: E731
    else:
        publishing = Publishing(client, int(axes), float(rate_hz))
        threading.Thread(target=publishing.run, daemon=True).start()
        count = lambda: publishing.count  # noqa: E731
    client.loop_start()
    for _ in sys.stdin:
        sys.stdout.write(f"{count()}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
