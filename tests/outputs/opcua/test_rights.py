"""The service with an OPC UA server: it shows the condition of the page to whoever may see it."""

from contextlib import AsyncExitStack, suppress
from pathlib import Path

import httpx
import pytest
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from click.testing import CliRunner

from edge_service.cli.entry import cli
from edge_service.config import ConfigError, load_config
from edge_service.health.store.store import FILE_NAME, Store
from edge_service.health.store.tokens import Tokens
from edge_service.nodes.output_node import make_output
from edge_service.outputs.opcua import URI

from ...certificates import write_pair
from ...drivers.bench import free_port
from ...nodes.conftest import PIPELINE, running, until

AXIS = '[[axes]]\nname = "X"\n'


def configured(folder: Path, opcua: str, http: str = "") -> Path:
    path = folder / "edge.toml"
    path.write_text(
        f'[bus]\nendpoint = "tcp/127.0.0.1:0"\n[http]\nport = 0\n{http}\n'
        f"[outputs.opcua]\n{opcua}\n{AXIS}"
    )
    path.chmod(0o600)
    return path


@pytest.mark.parametrize(
    ("opcua", "complaint"),
    [
        ('endpoint = "opc.tcp://192.168.1.2"', "outputs.opcua.endpoint: '192.168.1.2' is not a"),
        ('certificate = "a.pem"', "outputs.opcua.private_key: missing"),
        (
            'endpoint = "opc.tcp://10.0.0.1"\ncertificate = "a.pem"\nprivate_key = "a.key.pem"',
            "outputs.opcua.endpoint: beyond loopback it needs a token",
        ),
        ('endpoint = "http://127.0.0.1"', "expected an address of the form opc.tcp://127.0.0.1"),
        ("sessions = 1", "outputs.opcua.sessions: unknown key"),
    ],
)
def test_what_would_be_open_to_all_is_refused(opcua: str, complaint: str, tmp_path: Path) -> None:
    config = load_config(configured(tmp_path, opcua))
    with pytest.raises(ConfigError, match=r"^[^\n]*$") as caught:
        make_output(config, "opcua")
    assert complaint in str(caught.value)
    assert str(caught.value).startswith(f"{tmp_path / 'edge.toml'}: ")


@pytest.mark.parametrize("wrong", ["no uri", "missing", "another's", "open"])
def test_check_config_says_what_is_wrong_with_a_certificate(wrong: str, tmp_path: Path) -> None:
    certificate, key = write_pair(tmp_path, "a", None if wrong == "no uri" else URI)
    if wrong == "missing":
        certificate.unlink()
    elif wrong == "another's":
        write_pair(tmp_path, "b", URI)[1].replace(key)
    elif wrong == "open":
        key.chmod(0o644)
    path = configured(tmp_path, 'certificate = "a.pem"\nprivate_key = "a.key.pem"')
    result = CliRunner().invoke(cli, ["check-config", str(path)])
    assert isinstance(result.exception, ConfigError), result.output
    assert "opcua." in str(result.exception)
    assert "\n" not in str(result.exception)


@pytest.mark.slow
async def test_condition_is_that_of_page_and_shown_to_whoever_has_a_token(tmp_path: Path) -> None:
    write_pair(tmp_path, "server", URI)
    own = write_pair(tmp_path, "client", "urn:somebody:else")
    tokens = Tokens(Store(tmp_path / "state" / FILE_NAME))
    secret = tokens.add("scada", "viewer", 0)
    tokens.add("kim", "operator", 0)
    port = free_port()
    path = configured(
        tmp_path,
        f'endpoint = "opc.tcp://127.0.0.1:{port}"\n'
        'certificate = "server.pem"\nprivate_key = "server.key.pem"',
        '[store]\nfolder = "state"',
    )
    url = f"opc.tcp://127.0.0.1:{port}/edge-service/"

    async def client(user: str, password: str, *, encrypted: bool = True) -> Client:
        made = Client(url)
        made.application_uri = "urn:somebody:else"
        if encrypted:
            await made.set_security(
                SecurityPolicyBasic256Sha256,
                *map(str, own),
                server_certificate=tmp_path / "server.pem",
            )
        made.set_user(user)
        made.set_password(password)
        return made

    async with running(load_config(path), ("opcua", *PIPELINE)) as service:
        address = await service.address
        headers = {"authorization": f"Bearer {secret}"}
        async with httpx.AsyncClient(base_url=address, headers=headers) as page:

            async def connected() -> Client | None:
                reader = await client("scada", secret)
                try:
                    await reader.connect()
                except OSError:  # its address space is being built
                    return None
                return reader

            async with AsyncExitStack() as stack:
                reader = await until(connected)
                stack.push_async_callback(reader.disconnect)
                index = await reader.get_namespace_index("urn:edge-service:axes")
                node = reader.get_node(f"ns={index};s=X.Condition")

                async def agrees() -> bool:
                    shown = (await page.get("/api/v1/axes/X/health")).json()["condition"]
                    return shown != "UNAVAILABLE" and await node.read_value() == shown

                await until(agrees)
                for user, password, encrypted in (
                    ("scada", "edge-wrong", True),
                    ("other", secret, True),
                    ("", "", True),
                    ("scada", secret, False),
                ):
                    with pytest.raises(ua.UaError):
                        await (await client(user, password, encrypted=encrypted)).connect()
                tokens.revoke("scada")

                async def ended() -> bool:
                    with suppress(ua.UaError):
                        return await node.read_value() is None
                    return True

                await until(ended)
            with pytest.raises(ua.UaError):
                await (await client("scada", secret)).connect()
