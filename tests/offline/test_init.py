"""`init` writes a configuration that is right, or nothing; it never asks where nobody answers."""

import asyncio
import re
from contextlib import suppress
from pathlib import Path

import pytest

from drivers.stub import Fault
from edge_service.cli.entry import main
from edge_service.config import DEFAULT_CONFIG, load_config, load_machine
from edge_service.nodes.stub_node import make_stub
from edge_service.offline.init.greetings import GREETINGS, find_devices
from edge_service.offline.init.source import source_of
from tests.drivers.bench import free_port

SHEET = ("--lead", "20", "--inertia", "1.5e-3")
EXAMPLES = DEFAULT_CONFIG.parent / "drivers"


async def found_beside_a_stub(config: Path, protocol: str, port: int) -> list[str]:
    """Device that is found at the port of a stub."""
    stub = make_stub(protocol, load_config(config), None, "healthy", None)
    stub.fault = Fault()
    await stub.start()
    try:
        return await find_devices("127.0.0.1", port)
    finally:
        await stub.close()


@pytest.mark.parametrize(
    ("protocol", "known", "usual"), [("modbus", "modbus", "5020"), ("opcua", "opc.tcp", "4840")]
)
async def test_a_device_is_told_by_its_answer(
    protocol: str, known: str, usual: str, tmp_path: Path
) -> None:
    port = free_port()
    config = tmp_path / "stub.toml"
    example = (EXAMPLES / f"{protocol}.toml").read_text().replace(usual, str(port))
    config.write_text(example.replace('machine = "../machine.toml"\n', ""))
    assert await found_beside_a_stub(config, protocol, port) == [f"{known}://127.0.0.1:{port}"]


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\x20", b"\0\1"])
async def test_a_server_of_another_kind_is_no_device(answer: bytes) -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(OSError):
            await reader.read(16)
            writer.write(answer)
            await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        assert await find_devices("127.0.0.1", server.sockets[0].getsockname()[1]) == []


async def test_a_broker_is_told_by_its_answer() -> None:
    """Remaining length and reserved bits of CONNECT are checked as MQTT 3.1.1 has them."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await reader.read(2)
        body = await reader.read(64)
        if head[:1] == b"\x10" and head[1] == len(body) and body[:7] == b"\0\4MQTT\4":
            writer.write(b"\x20\2\0\5")  # not authorised: a broker all the same
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        port = server.sockets[0].getsockname()[1]
        assert await find_devices("127.0.0.1", port) == [f"mqtt://127.0.0.1:{port}"]


@pytest.mark.parametrize(
    ("address", "driver"),
    [
        ("modbus://127.0.0.1:{port}", "modbus"),
        ("opc.tcp://127.0.0.1:{port}", "opcua"),
        ("mqtt://127.0.0.1:{port}/a/b", "mqtt"),
    ],
)
def test_what_is_written_is_right(
    address: str, driver: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The device may be off; the configuration is read again as it will be."""
    out = tmp_path / "shop" / "edge.toml"
    line = ["init", address.format(port=free_port()), *SHEET, "--out", str(out), "--axis", "Z"]
    assert main(line) == 0
    config = load_config(out)
    assert [(axis.name, axis.driver) for axis in config.axes] == [("Z", driver)]
    assert load_machine(config.axes[0].machine).axis.lead_m == pytest.approx(0.02)
    assert config.store.folder == out.parent / "history"
    assert sorted(each.name for each in out.parent.iterdir()) == ["edge.toml", "machine.toml"]
    said = capsys.readouterr().out
    assert "not reachable now" in said
    assert f"edge-service doctor --config {out}" in said
    assert main(["check-config", str(out)]) == 0


@pytest.mark.parametrize("protocol", GREETINGS)
def test_every_protocol_that_is_found_has_a_driver(protocol: str) -> None:
    driver = source_of([f"{protocol}://127.0.0.1:9"]).driver
    assert (EXAMPLES / f"{driver}.toml").is_file()


def test_a_recording_is_adopted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace, out = tmp_path / "trace.csv", tmp_path / "edge.toml"
    simulate = ["simulate", "--motion", "friction", "--out", str(trace)]
    assert main(simulate) == 0
    assert main(["init", str(trace), "--lead", "20", "--out", str(out)]) == 0
    axis = load_config(out).axes[0]
    assert (axis.driver, axis.settings["path"]) == ("replay", str(trace))
    assert "understood:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["modbus://127.0.0.1:9"], "--machine: missing; or give at least --lead and --inertia"),
        (["profibus://127.0.0.1:9", *SHEET], "expected a recording, a host, or modbus://"),
        (["modbus://127.0.0.1:99999", *SHEET], "expected a recording, a host, or modbus://"),
        (["modbus://", *SHEET], "expected a recording, a host, or modbus://"),
        (["modbus://127.0.0.1:9", *SHEET, "--axis", "a/b"], "axes[0].name"),
        (["modbus://127.0.0.1:9", "--machine", "nowhere.toml"], "nowhere.toml: no such file"),
        (["a.csv", "b.csv"], "several sources"),
    ],
)
def test_a_mistake_writes_nothing(
    more: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", *more, "--out", str(tmp_path / "edge.toml")]) == 2
    complaint = capsys.readouterr().err.strip()
    assert expected in complaint
    assert "\n" not in complaint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["edge.toml", "machine.toml"])
def test_nothing_is_overwritten_unasked(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text("mine")
    line = ["init", f"modbus://127.0.0.1:{free_port()}", *SHEET]
    line += ["--out", str(tmp_path / "edge.toml")]
    assert main(line) == 2
    assert f"{name}: is there already; --force overwrites it" in capsys.readouterr().err
    assert [each.read_text() for each in tmp_path.iterdir()] == ["mine"]
    assert main([*line, "--force"]) == 0
    assert "mine" not in (tmp_path / name).read_text()


def test_a_device_that_does_not_fit_yet_is_written_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A topic that no broker takes is refused by the driver's own rules."""
    out = tmp_path / "edge.toml"
    line = ["init", f"mqtt://127.0.0.1:{free_port()}/a+b", *SHEET, "--out", str(out)]
    assert main(line) == 1
    said = capsys.readouterr().out
    assert re.search(r"not right yet: \S*edge.toml: axes.X.settings.topic", said)
    assert f"edge-service check-config {out}" in said
    assert out.is_file()
