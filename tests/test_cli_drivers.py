"""`stub` and `doctor`: what they serve, and what they print for people."""

import asyncio
import json
import signal
import struct
import sys
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_CONFIG, DEFAULT_MACHINE, load_config, load_machine
from edge_service.messages.samples import TORQUE, SampleFrame
from edge_service.nodes.stub_node import make_stub
from edge_service.offline import doctor
from edge_service.recordings.writer import TraceWriter

from .drivers.bench import ROOT, free_port
from .nodes.conftest import production
from .programs import serving

MODBUS = """
[[axes]]
name = "X"
driver = "modbus"
[axes.settings]
url = "modbus://127.0.0.1:{port}"
poll_groups = {{ all = 0.02 }}
registers = [{{ channel = "torque_command_nm", address = 0{more} }}]
"""


def modbus(port: int = 1, more: str = "") -> str:
    return MODBUS.format(port=port, more=more)


FIRST_MESSAGES = {
    "modbus": bytes.fromhex("000100000006010300000001"),  # read holding register 0 of unit 1
    "opcua": b"HELF" + struct.pack("<6Ii", 32, 0, 65_536, 65_536, 0, 0, -1),
}


@pytest.mark.parametrize("protocol", FIRST_MESSAGES)
async def test_a_stub_is_served_on_another_port(protocol: str) -> None:
    """The port of its configuration may be in use, by a demo for instance."""
    port = free_port()
    config = load_config(DEFAULT_CONFIG.parent / "drivers" / f"{protocol}.toml")
    axes = [axis.model_copy(update={"machine": DEFAULT_MACHINE}) for axis in config.axes]
    changed = config.model_copy(update={"axes": tuple(axes)})
    stub = make_stub(protocol, changed, None, "healthy", None, port)
    try:
        assert (await stub.start()).endswith(f":{port}")
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(FIRST_MESSAGES[protocol])
        assert await asyncio.wait_for(reader.read(1), 60.0)
        writer.close()
        await writer.wait_closed()
    finally:
        await stub.close()


def test_a_device_that_is_not_there_is_a_finding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = modbus(free_port())
    both = str(tmp_path / "edge.toml")
    Path(both).write_text(text + text.replace('name = "X"', 'name = "Y"'))
    assert main(["doctor", both]) == 1
    assert " ".join(capsys.readouterr().out.split()).count("DOUBT connection") == 2
    assert main(["doctor", both, "--json"]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    found = {each["axis"]: each["findings"] for each in json.loads(line)["axes"]}
    assert [each[0]["verdict"] for each in found.values()] == ["doubtful"] * 2
    assert list(found) == ["X", "Y"]


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds of production motion, with the torque the wrong way round."""
    frame = production(load_machine(DEFAULT_MACHINE), 6.8, 10_000)
    wrong = SampleFrame(frame.time_s, {**frame.channels, TORQUE: -frame.channels[TORQUE]})
    path = tmp_path_factory.mktemp("doctor") / "inverted.csv"
    with TraceWriter(path, tuple(wrong.channels)) as writer:
        writer.write(wrong)
    return path


def test_a_source_that_says_nothing_is_a_finding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "QUIET_S", 0.1)
    path = tmp_path / "edge.toml"
    path.write_text('[[axes]]\nname = "X"\ndriver = "folder"\nsettings = { folder = "." }\n')
    assert main(["doctor", str(path), "--duration", "0.1"]) == 1
    assert "DOUBT connection   no samples came" in capsys.readouterr().out


def test_the_doctor_reads_a_recording(trace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", str(trace)]) == 1
    printed = capsys.readouterr().out
    assert "torque sign looks inverted: inertia and friction read negative" in printed
    assert "1 of 12 checks raised doubts\n  the preload can be estimated, once" in printed
    assert main(["doctor", str(trace), "--json"]) == 1
    findings = {each["name"]: each for each in json.loads(capsys.readouterr().out)["findings"]}
    assert findings["torque"]["verdict"] == "doubtful"
    figure = findings["torque"]["figure"]
    assert figure["low"] < -0.0015 < figure["high"] < 0.0
    assert findings["lead"]["verdict"] == "fits"


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["modbus", "opcua"])
def test_a_stub_serves_what_the_doctor_finds_in_order(
    protocol: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The sample configurations, as in the README, on a free port."""
    text = (ROOT / "deploy" / "drivers" / f"{protocol}.toml").read_text()
    port = free_port()
    text = text.replace("port = 5020", f"port = {port}").replace(":4840", f":{port}")
    text = text.replace("../machine.toml", str(ROOT / "deploy" / "machine.toml"))
    config = str(tmp_path / "edge.toml")
    Path(config).write_text(text)
    line = (sys.executable, "-m", "edge_service", "stub", protocol, config)
    with serving(*line, folder=ROOT, end=signal.SIGINT) as said:
        assert "serving" in said.readline()
        status = main(["doctor", config, "--duration", "6"])
        printed = " ".join(capsys.readouterr().out.split())
        late = "DOUBT rate" in printed or "late_read" in printed  # a busy machine, or 10 Hz
        assert status == ("DOUBT" in printed) <= late
        assert "ok connection" in printed
        assert "ok lead" in printed
        assert "torque sign looks inverted" not in printed
        assert main(["check-config", config]) == 0
