"""Certificates, user and password: the right ones get in, the others name their key."""

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio

from drivers.base import DriverMisconfiguredError, DriverUnavailableError
from drivers.opcua.driver import OpcuaDriver
from drivers.opcua.variables import OpcuaConfig

from ...certificates import write_pair
from ..bench import CONTEXT, free_port
from .bench import config_of, stub_of

pytestmark = pytest.mark.asyncio(loop_scope="module")


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
