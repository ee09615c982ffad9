"""The client of the bus that the documents show works."""

import asyncio
import subprocess
import sys

from .documents import block
from .nodes.conftest import config_of, running


async def test_the_client_of_the_readme_hears_samples_and_preload() -> None:
    source = block("edge_service/bus/README.md", "python", "zenoh.open")
    config = config_of("simulated", {"scenario": "healthy", "speed": 20.0})
    async with running(config, ("acquire", "downsample", "estimate")) as service:
        client = await asyncio.create_subprocess_exec(
            sys.executable,
            "-I",
            "-c",
            source,
            service.bus.endpoint,
            stdout=subprocess.PIPE,
        )
        assert client.stdout is not None
        heard = set()
        try:
            async with asyncio.timeout(60.0):
                while heard < {"torque", "preload"}:
                    heard.add((await client.stdout.readline()).decode().split()[0])
        finally:
            client.kill()
            await client.wait()
    assert heard == {"torque", "preload"}
