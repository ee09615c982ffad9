"""The driver against its stub over a real socket: values, times, limits, faults.

Debian has no OPC UA server in C (open62541, FreeOpcUa) that it could be held against; the stub is
made of asyncua's own server.
"""

import asyncio
import time
import tomllib
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytest_asyncio
from asyncua import ua
from pydantic import ValidationError

from drivers.base import DriverMisconfiguredError, DriverUnavailableError
from drivers.opcua.driver import OpcuaDriver
from drivers.opcua.session import OpcuaSession
from drivers.opcua.stub import LEAST_INTERVAL_S, OpcuaStub
from drivers.opcua.variables import OpcuaConfig
from drivers.stub import Fault, FaultKind
from edge_service.config.mistakes import explain
from edge_service.messages import samples
from edge_service.messages.samples import Quality, SampleFrame

from ...certificates import write_pair
from ..bench import CONTEXT, free_port, take, truth
from .bench import SIGNALS, config_of, stub_of

pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(loop_scope="module")
async def driver(config: OpcuaConfig, stub: OpcuaStub) -> AsyncIterator[OpcuaDriver]:
    assert stub.fault == Fault()
    made = OpcuaDriver(config, CONTEXT)
    await made.open()
    yield made
    await made.close()


async def until(driver: OpcuaDriver, found: Callable[[SampleFrame], Any]) -> SampleFrame:
    async with asyncio.timeout(60.0), aclosing(driver.frames()) as source:
        async for frame in source:
            if found(frame):
                return frame
    raise AssertionError("no such frame")


async def test_values_and_times_are_those_of_the_source(driver: OpcuaDriver) -> None:
    frames = await take(driver, 6)
    for frame in frames:
        assert (np.abs(frame.time_s - time.time()) < 5.0).all()
        for torque, angle, table in zip(
            frame.channels[samples.TORQUE],
            frame.channels[samples.ANGLE],
            frame.channels[samples.TABLE_POSITION],
            strict=True,
        ):
            number = round(angle / 0.5)
            expected = truth(number)
            assert torque == pytest.approx(expected[samples.TORQUE])
            assert table == pytest.approx(expected[samples.TABLE_POSITION])
        np.testing.assert_allclose(frame.channels[samples.TEMPERATURE], 21.5)
    time_s = np.concatenate([frame.time_s for frame in frames])
    steps = np.diff(time_s)
    assert np.median(steps) == pytest.approx(LEAST_INTERVAL_S, abs=0.03)


async def test_old_values_are_found_by_a_heartbeat(driver: OpcuaDriver, stub: OpcuaStub) -> None:
    await take(driver, 1)
    stub.fault = Fault(FaultKind.STALE)
    stale = np.uint8(Quality.STALE)
    frame = await until(driver, lambda f: stale in f.quality.get(samples.TORQUE, ()))
    assert (np.array(frame.quality[samples.ANGLE]) == stale).any()
    assert np.isnan(frame.channels[samples.TORQUE][-1])


async def test_a_server_that_hangs_is_lost_in_time(driver: OpcuaDriver, stub: OpcuaStub) -> None:
    await take(driver, 1)
    stub.fault = Fault(FaultKind.HANG)
    with pytest.raises(
        DriverUnavailableError, match=r"no message for 1\.5 s|connection closed|ended"
    ):
        await take(driver, 1000)


async def test_the_socket_of_a_lost_session_is_closed(
    config: OpcuaConfig, stub: OpcuaStub, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A loss that the library's own look at the server finds, and a goodbye without an answer."""
    monkeypatch.setattr("drivers.opcua.session.GOODBYE_S", 0.1)
    session = OpcuaSession(config, {})
    await session.open()
    assert session._client is not None and stub._server is not None
    socket = session._client.uaclient.protocol.transport
    stub.fault = Fault(FaultKind.HANG)
    for transport in stub._server.iserver.asyncio_transports:
        transport.pause_reading()
    with pytest.raises(DriverUnavailableError, match="connection closed"):
        while True:
            await session.next(60.0)
    assert socket.is_closing()
    assert not session.connected


async def test_of_publications_that_nobody_reads_the_oldest_are_dropped_and_counted(
    config: OpcuaConfig, stub: OpcuaStub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("drivers.opcua.session.MOST_WAITING", 2)
    driver = OpcuaDriver(config, CONTEXT)
    await driver.open()
    session = driver._session
    assert session is not None and session._client is not None
    for code in range(5):  # in one turn of the event loop: nothing comes between
        await session._client.uaclient.session.inform_subscriptions(ua.StatusCode(ua.UInt32(code)))
    results = [await session.next(60.0) for _ in range(2)]
    codes = [r.NotificationMessage.NotificationData[0].Status.value for r in results if r]
    assert codes == [3, 4]
    assert driver.counters["dropped_publications"] >= 3
    await driver.close()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no such node": (
        {"signals": [{"channel": samples.TORQUE, "node": "ns=2;s=Y.torque"}]},
        r"signals\[0\]\.node: 'ns=2;s=Y\.torque': BadNodeIdUnknown",
    ),
    "no such namespace": (
        {"signals": [{"channel": samples.TORQUE, "node": "nsu=urn:no;s=X.torque"}]},
        r"signals\[0\]\.node: .*no namespace 'urn:no'",
    ),
    "an object": (
        {"signals": [{"channel": samples.TORQUE, "node": "i=85"}]},
        r"signals\[0\]\.node: cannot be subscribed to: BadAttributeIdInvalid",
    ),
}


@pytest.mark.parametrize("name", WRONG)
async def test_a_mistake_names_its_key(name: str, config: OpcuaConfig, stub: OpcuaStub) -> None:
    changes, expected = WRONG[name]
    driver = OpcuaDriver(OpcuaConfig.model_validate(config.model_dump() | changes), CONTEXT)
    for attempt in (driver.open, driver.probe):
        with pytest.raises(DriverMisconfiguredError, match=expected):
            await attempt()
    await driver.close()


STATED = {"X.position": 5066068, "X.angle": 17476}
"""Variable -> id of mm, of degree (the OPC Foundation's UNECE_to_OPCUA.csv)."""


@pytest_asyncio.fixture(loop_scope="module")
async def stated_units(stub: OpcuaStub) -> AsyncIterator[None]:
    assert stub._server is not None
    properties = []
    for name, number in STATED.items():
        unit = ua.EUInformation(UnitId=ua.Int32(number))
        node = stub._server.get_node(f"ns=2;s={name}")
        properties.append(await node.add_property(f"ns=2;s={name}.u", "0:EngineeringUnits", unit))
    yield
    for each in properties:
        await each.delete()


@pytest.mark.usefixtures("stated_units")
@pytest.mark.parametrize(
    ("angle", "table", "problem"),
    [
        ({"unit": "deg"}, {"unit": "mm"}, None),
        ({"unit": "deg", "scale": -1.0}, {"scale": 0.001}, None),
        ({"unit": "deg"}, {}, r"signals\[2\]\.unit: 'm', but the server states 'mm'"),
        ({}, {"unit": "mm"}, r"signals\[1\]\.unit: 'rad', but the server states 'deg'"),
        ({"scale": -1.0}, {"unit": "mm"}, r"signals\[1\]\.unit: 'rad', but the server"),
    ],
)
async def test_a_unit_that_the_server_states_must_be_the_one_here(
    angle: dict[str, Any], table: dict[str, Any], problem: str | None, config: OpcuaConfig
) -> None:
    changes: list[dict[str, Any]] = [{}, {"unit": None} | angle, {"unit": None} | table]
    signals = [old | new for old, new in zip(SIGNALS, changes, strict=False)]
    settings = config.model_dump() | {"signals": signals}
    driver = OpcuaDriver(OpcuaConfig.model_validate(settings), CONTEXT)
    refused = pytest.raises(DriverMisconfiguredError, match=problem)
    with nullcontext() if problem is None else refused:
        await driver.open()
    await driver.close()


MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))


@pytest.mark.parametrize("name", MISTAKES)
async def test_a_mistake_in_the_file_names_its_key(name: str) -> None:
    changes = dict(MISTAKES[name])
    expected = changes.pop("said")
    with pytest.raises(ValidationError) as caught:
        config_of(4840, **changes)
    assert expected in explain(caught.value, OpcuaConfig)[0]


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def secured(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[OpcuaConfig]:
    folder = tmp_path_factory.mktemp("pki")
    client, key = write_pair(folder, "client", "urn:edge-service:client")
    server, _ = write_pair(folder, "server", "urn:edge-service:stub")
    write_pair(folder, "stranger", "urn:edge-service:client")
    config = config_of(
        free_port(),
        security="Basic256Sha256",
        certificate=client,
        private_key=key,
        server_certificate=server,
        user="operator",
        password="correct horse",
    )
    stub = stub_of(config)
    await stub.start()
    yield config
    await stub.close()


async def test_the_right_certificate_user_and_password_get_in(secured: OpcuaConfig) -> None:
    driver = OpcuaDriver(secured, CONTEXT)
    await driver.open()
    frames = driver.frames()
    assert len(await anext(frames)) > 0
    await frames.aclose()
    await driver.close()


def stranger(config: OpcuaConfig, key: str) -> Path:
    name = "stranger.key.pem" if key == "private_key" else "stranger.pem"
    assert config.certificate is not None
    return config.certificate.parent / name


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "wrong password": ({"password": "wrong"}, "user: .*BadUserAccessDenied"),
    "wrong user": ({"user": "nobody"}, "user: .*BadUserAccessDenied"),
    "no user": ({"user": None, "password": None}, "user: .*BadIdentityTokenRejected"),
    "a file that is not there": ({"private_key": "/no/such.pem"}, "private_key: .*no such file"),
}


@pytest.mark.parametrize("name", REFUSED)
async def test_who_is_refused_is_reported_the_key(name: str, secured: OpcuaConfig) -> None:
    changes, expected = REFUSED[name]
    config = OpcuaConfig.model_validate(secured.model_dump() | changes)
    with pytest.raises(DriverMisconfiguredError, match=expected):
        await OpcuaDriver(config, CONTEXT).open()


async def test_a_certificate_that_is_not_trusted_is_refused(secured: OpcuaConfig) -> None:
    strange = {key: stranger(secured, key) for key in ("certificate", "private_key")}
    config = OpcuaConfig.model_validate(secured.model_dump() | strange)
    with pytest.raises((DriverMisconfiguredError, DriverUnavailableError)):
        await OpcuaDriver(config, CONTEXT).open()


async def test_a_server_with_another_certificate_is_not_talked_to(secured: OpcuaConfig) -> None:
    other = {"server_certificate": stranger(secured, "server_certificate")}
    config = OpcuaConfig.model_validate(secured.model_dump() | other)
    with pytest.raises((DriverMisconfiguredError, DriverUnavailableError)):
        await OpcuaDriver(config, CONTEXT).open()
