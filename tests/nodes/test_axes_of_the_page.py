"""Axes that are made on the page, and who may reach it: certificate and tokens."""

import asyncio
import tomllib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import trustme

from edge_service.bus.fleet import ask_health
from edge_service.config import ConfigError, HttpConfig, load_config
from edge_service.config_tables import StoreConfig
from edge_service.nodes.http_rights import check_access, knows_of, server_files, tokens_of
from tests.certificates import write_certificates

from .conftest import config_of, once, running, served, until

AXIS = {"driver": "simulated", "settings": {"scenario": "healthy", "speed": 20.0}}
PATH = "/api/v1/axes/{}/config"


def written(folder: Path, axes: str = "") -> Path:
    path = folder / "edge.toml"
    ports = '[bus]\nendpoint = "tcp/127.0.0.1:0"\n[http]\nport = 0\n'
    path.write_text(f'{ports}[store]\nfolder = "state"\n{axes}')
    return path


@pytest.fixture
async def client(tmp_path: Path) -> AsyncIterator[httpx.AsyncClient]:
    """A service whose configuration has the axis Y."""
    axes = '[[axes]]\nname = "Y"\n[axes.settings]\nscenario = "healthy"\n'
    async with served(load_config(written(tmp_path, axes))) as (_, client):
        yield client


async def test_an_axis_is_made_on_the_page_and_goes_again(
    client: httpx.AsyncClient, tmp_path: Path
) -> None:
    folder = tmp_path / "state" / "axes" / "X"
    made = await client.put(PATH.format("X"), json=AXIS)
    assert (made.status_code, made.json()["driver"]) == (201, "simulated")
    assert {each.name for each in folder.iterdir()} == {"axis.toml", "machine.toml"}
    is_there = lambda now: now["status"] == "estimated"  # noqa: E731
    await once(client, "axes/X/preload", is_there)
    parts = (await client.get("/api/v1/health")).json()["components"]
    assert {each["component"] for each in parts if each["axis"] == "X"} == {"acquire", "estimate"}
    assert [each.name for each in load_config(tmp_path / "edge.toml").axes] == ["Y", "X"]

    answer = (await client.get(PATH.format("X"))).json()
    answer["machine"]["axis"] |= {"stroke_m": 0.7, "max_speed_rad_s": 200.0}
    changed = await client.put(PATH.format("X"), json=answer)
    assert (changed.status_code, changed.json()["machine"]) == (200, answer["machine"])
    assert len(list(folder.glob("machine*.toml"))) == 2
    motions = (await client.get("/api/v1/axes/X/motions")).json()["motions"]
    assert {each["refused"] for each in motions} == {None}
    assert [each["name"] for each in motions if each["left_out"]] == ["friction", "full"]

    assert (await client.delete(PATH.format("X"))).status_code == 204
    assert (await client.get("/api/v1/axes/X/preload")).status_code == 404
    assert not folder.exists()
    assert (await client.put(PATH.format("X"), json=AXIS)).status_code == 201
    await once(client, "axes/X/preload", is_there)


async def test_of_an_axis_that_goes_nothing_stays_on_the_bus(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, '[[axes]]\nname = "X"\n[[axes]]\nname = "Y"\n'))

    async def there(*axes: str) -> None:
        async def are_there() -> bool:
            found = await asyncio.to_thread(ask_health, service.bus.endpoint)
            return {axis for _, _, axis in found} == {*axes}

        await until(are_there)

    async with running(config, ("health",)) as service:
        await there("X", "Y")
        machine = service.context.machines["X"]
        service.context.drop("X")
        await there("Y")
        service.context.renew(config.axes[0], machine)
        await there("X", "Y")


async def test_what_is_shown_of_an_axis_can_be_sent_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also by a service whose configuration is named relative to its working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "state" / "recordings").mkdir(parents=True)
    rows = "".join(f"{0.001 * number},0.1,{0.01 * number}\n" for number in range(2000))
    trace = tmp_path / "state" / "recordings" / "a.csv"
    trace.write_text(f"time_s,torque_command_nm,motor_angle_rad\n{rows}")
    shown = {"driver": "replay", "settings": {"path": "../../recordings/a.csv", "loop": True}}
    for status in (201, 200):
        config = load_config(written(tmp_path).relative_to(tmp_path))
        async with served(config) as (_, client):
            assert (await client.put(PATH.format("X"), json=shown)).status_code == status
            shown = (await client.get(PATH.format("X"))).json()


async def test_an_axis_lasts_as_long_as_a_service_that_keeps_nothing(tmp_path: Path) -> None:
    config = load_config(written(tmp_path)).model_copy(update={"store": StoreConfig()})
    async with served(config) as (_, client):
        assert (await client.put(PATH.format("X"), json=AXIS)).status_code == 201
        await once(client, "axes/X/preload", lambda now: now["status"] == "estimated")
    assert [path.name for path in tmp_path.iterdir()] == ["edge.toml"]


WRONG = tomllib.loads(Path(__file__).with_name("wrong_axes.toml").read_text("utf-8"))["wrong"]


async def test_what_is_wrong_changes_nothing(client: httpx.AsyncClient, tmp_path: Path) -> None:
    for axis, change, status, said in WRONG:
        answer = await client.put(PATH.format(axis), json=AXIS | change)
        assert (answer.status_code, said in answer.json()["detail"]) == (status, True), said
    assert list((tmp_path / "state").glob("axes/*")) == []
    assert [each["axis"] for each in (await client.get("/api/v1/axes")).json()["axes"]] == ["Y"]


def test_each_axis_has_one_owner_and_its_mistakes_are_told_by_its_file(tmp_path: Path) -> None:
    table = '[[axes]]\nname = "X"\n'
    folder = tmp_path / "state" / "axes" / "X"
    folder.mkdir(parents=True)
    (folder / "axis.toml").write_text(table)
    assert [each.name for each in load_config(written(tmp_path)).axes] == ["X"]
    with pytest.raises(ConfigError, match=r"axis.toml: axes.X: stands in .*edge.toml as well"):
        load_config(written(tmp_path, table))
    for wrong, said in (
        (table.replace("X", "Z"), "axes.Z: expected the name 'X'"),
        (f"{table}motor = 1\n", "axes.X.motor: unknown key"),
        (table * 2, "axes: "),
    ):
        (folder / "axis.toml").write_text(wrong)
        with pytest.raises(ConfigError, match=f"axis.toml: {said}"):
            load_config(written(tmp_path))


def configured(folder: Path, **http: Any) -> Any:
    store = StoreConfig(folder=folder / "state")
    return config_of("simulated", {}, http=HttpConfig(port=0, **http), store=store)


def test_loopback_needs_nothing_until_a_token_exists(tmp_path: Path) -> None:
    config = configured(tmp_path)
    assert check_access(config) == "no TLS, for any user of this machine"
    tokens_of(config).add("kim", "viewer", 0)
    assert check_access(config) == "no TLS, for whoever has one of 1 tokens"
    file = tmp_path / "state" / "edge-service.sqlite"
    file.write_bytes(b"rubbish")
    assert "tokens cannot be read" in check_access(config)
    assert (knows_of(config) is None, file.read_bytes()) == (False, b"rubbish")


def test_beyond_loopback_and_behind_a_proxy_a_token_is_needed(tmp_path: Path) -> None:
    certificate, key = write_certificates(tmp_path)
    public = {"host": "192.0.2.1", "certificate": certificate, "private_key": key}
    for http, place in ((public, "host"), ({"url": "https://mill7.plant/"}, "url")):
        config = configured(tmp_path / place, **http)
        with pytest.raises(ConfigError, match=rf"http\.{place}: .* edge-service token CONFIG"):
            check_access(config)
        tokens_of(config).add("kim", "operator", 0)
        assert check_access(config).endswith("for whoever has one of 1 tokens")


def test_certificate_and_key_must_fit_and_others_read_no_key(tmp_path: Path) -> None:
    certificate, key = write_certificates(tmp_path)
    http = HttpConfig(certificate=certificate, private_key=key)
    assert server_files(http) == (certificate, key)
    key.chmod(0o604)
    with pytest.raises(ConfigError, match=r"http\.private_key: .* others may read"):
        server_files(http)
    other = trustme.CA().issue_cert("localhost")
    other.private_key_pem.write_to_path(key)
    key.chmod(0o600)
    with pytest.raises(ConfigError, match=r"http\.certificate: .* KEY_VALUES_MISMATCH"):
        server_files(http)


async def test_a_token_that_is_added_beside_running_service_counts_at_once(tmp_path: Path) -> None:
    config = configured(tmp_path)
    async with served(config, ("http",)) as (_, client):
        assert (await client.get("api/v1/axes")).status_code == 200
        secret = tokens_of(config).add("kim", "operator", 0)

        async def is_closed() -> bool:
            return (await client.get("api/v1/axes")).status_code == 401

        await until(is_closed)
        client.headers["authorization"] = f"Bearer {secret}"
        made = await client.post("api/v1/tokens", json={"name": "jo", "role": "viewer"})
        assert made.status_code == 201

        async def told() -> list[str]:
            items = (await client.get("api/v1/log?kind=command")).json()["items"]
            return [each["text"] for each in items]

        assert await until(told) == ["kim (127.0.0.1): POST /api/v1/tokens"]
