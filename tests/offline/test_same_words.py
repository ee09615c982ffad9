"""All commands, and a running axis, name a fault of a recording in the same words."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from edge_service.checks.examination import check_plausibility
from edge_service.checks.live.channel_check import channel_reasons
from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.features import FAULT_WORDS, Fault
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TIME, TORQUE, Floats, SampleFrame

from ..bench.real_machines import written
from ..fingerprint.test_examination import recorded

MACHINE = load_machine(DEFAULT_MACHINE)
FAULTS: dict[str, tuple[str, Callable[[SampleFrame], SampleFrame]]] = {
    "sign": ("torque", lambda frame: scaled(frame, TORQUE, -1.0)),
    "unit": ("torque", lambda frame: scaled(frame, TORQUE, 1e3)),
    "lead": ("lead", lambda frame: scaled(frame, TABLE_POSITION, 0.5)),
    "clock": ("rate", lambda frame: SampleFrame(1e3 * frame.time_s, frame.channels)),
    "stuck": ("signals", lambda frame: scaled(frame, TORQUE, 0.0)),
}
"""Question -> check that asks it, and what goes wrong."""


def scaled(frame: SampleFrame, channel: str, factor: float) -> SampleFrame:
    return SampleFrame(
        frame.time_s, {**frame.channels, channel: factor * frame.channels[channel] + 0.0}
    )


@pytest.fixture(scope="module")
def healthy() -> SampleFrame:
    frame = recorded(rows=12_000)
    kept = {name: frame.channels[name] for name in (ANGLE, TABLE_POSITION, TORQUE)}
    return SampleFrame(frame.time_s, kept)


@pytest.mark.parametrize("question", FAULTS)
def test_commands_say_what_doctor_says(
    question: str, healthy: SampleFrame, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, spoil = FAULTS[question]
    frame = spoil(healthy)
    found = {each.name: each for each in check_plausibility(MACHINE, [frame])}
    assert found[name].forbids
    trace = written(tmp_path / "trace.csv", {TIME: frame.time_s, **frame.channels})
    model = ["--machine", str(DEFAULT_MACHINE), str(trace)]
    told = found[name].sentence.partition(":")[0]
    for command, status in {"doctor": 1, "commission": 2, "fingerprint": 2, "diagnose": 3}.items():
        out = [] if command == "doctor" else ["--out", str(tmp_path / command)]
        assert main([command, *model, *out]) == status, command
        said = " ".join("".join(capsys.readouterr()).split())
        assert told in said, (command, said)
    proposed = str(tmp_path / "proposed.toml")
    adopt = ["adopt", str(trace), "--lead", "20", "--set", "inertia_kg_m2=1.5e-3"]
    assert main([*adopt, "--out", proposed, "--json"]) == 0
    doubts = json.loads(capsys.readouterr().out)["doubts"]
    assert main(["doctor", "--machine", proposed, str(trace)]) == bool(doubts)
    said = capsys.readouterr().out
    assert all(f"{each['name']:<13}{each['sentence']}" in said for each in doubts)
    if question == "stuck":
        (reason,) = channel_reasons(Fault.TORQUE_STUCK)
        assert reason.partition(": ")[2] in found[name].sentence


@pytest.mark.parametrize(
    ("channel", "spoil", "fault"),
    [
        (TORQUE, lambda values: values[len(values) // 2], Fault.TORQUE_STUCK),
        (TABLE_POSITION, lambda values: values[len(values) // 2], Fault.TABLE_STUCK),
        (TABLE_POSITION, lambda values: values + 5e-4, Fault.TABLE_SHIFTED),
    ],
)
def test_what_fails_within_a_recording_is_said_as_a_running_axis_says_it(
    channel: str,
    spoil: Callable[[Floats], Floats],
    fault: Fault,
    healthy: SampleFrame,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    values = healthy.channels[channel]
    late = np.arange(len(values)) >= len(values) // 2
    channels = healthy.channels | {channel: np.where(late, spoil(values), values)}
    trace = written(tmp_path / "trace.csv", {TIME: healthy.time_s, **channels})
    model, (reason,) = ["--machine", str(DEFAULT_MACHINE), str(trace)], channel_reasons(fault)
    for command in ("doctor", "commission", "diagnose"):
        out = [] if command == "doctor" else ["--out", str(tmp_path / command)]
        assert main([command, *model, *out, "--json"]) == (command == "doctor")
        assert FAULT_WORDS[fault] in capsys.readouterr().out, command
    assert main(["estimate", *model, "--out", str(tmp_path / "rows.csv")]) == 0
    assert reason.partition(":")[0] in (tmp_path / "rows.csv").read_text()
