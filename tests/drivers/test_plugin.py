"""The example package of the drivers' README is installed and run, as a stranger would."""

import asyncio
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest

from tests.programs import ran

from ..documents import ROOT, block

README = "drivers/README.md"
CONFIG = """
[bus]
endpoint = "tcp/127.0.0.1:0"
[[axes]]
name = "X"
driver = "csv_tcp"
[axes.settings]
port = {port}
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    source, target = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("site")
    (source / "pyproject.toml").write_text(block(README, "toml", "csv_over_tcp"))
    (source / "csv_over_tcp.py").write_text(block(README, "python", "class CsvTcpDriver"))
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    options = ["--no-deps", "--target", str(target), str(source)]
    done = ran(*command, *options)
    if "No matching distribution" in done.stderr:
        pytest.skip("pip cannot reach a package index for setuptools")
    assert done.returncode == 0, done.stderr
    return target


@pytest.fixture
async def device() -> AsyncIterator[int]:
    """A device of the README's protocol at 1 kHz; its port."""

    async def talk(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"time_s,torque_command_nm,motor_angle_rad\n")
        try:
            for row in range(1_000_000):
                writer.write(f"{row / 1000},0.2,{row / 100}\n".encode())
                if row % 20 == 0:
                    await writer.drain()
                    await asyncio.sleep(0.02)
        except OSError:
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(talk, "127.0.0.1", 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


async def run(site: Path, *arguments: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "edge_service",
        *arguments,
        env={"PYTHONPATH": f"{site}:{ROOT}", "PATH": "/usr/bin:/bin"},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )


async def test_installed_driver_runs_in_service(site: Path, device: int, tmp_path: Path) -> None:
    config = tmp_path / "edge.toml"
    config.write_text(CONFIG.format(port=device))
    service = await run(site, "run", str(config), "--port", "0")
    assert service.stdout is not None
    try:
        async with asyncio.timeout(60.0):
            line = (await service.stdout.readline()).decode()
            url = line.split()[-1]
            async with httpx.AsyncClient(base_url=url) as client:
                while True:
                    health = (await client.get("api/v1/axes/X/health")).json()
                    counters = {
                        name: count
                        for component in health["components"]
                        for name, count in component["counters"].items()
                    }
                    if counters.get("rows", 0) > 1000:
                        break
                    await asyncio.sleep(0.05)
    finally:
        service.terminate()
        await service.communicate()
    assert service.returncode == 0
