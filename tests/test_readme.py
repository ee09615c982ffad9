"""The programs that the documents show work: a client of the bus, and a bridge to a database."""

import asyncio
import re
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from .documents import block
from .nodes.conftest import config_of, running


@asynccontextmanager
async def lines_of(source: str) -> AsyncIterator[asyncio.StreamReader]:
    """Lines that a program prints beside a service, for a minute at most."""
    config = config_of("simulated", {"scenario": "healthy", "speed": 20.0})
    async with running(config, ("acquire", "downsample", "estimate")) as service:
        program = await asyncio.create_subprocess_exec(
            sys.executable, "-I", "-c", source, service.bus.endpoint, stdout=subprocess.PIPE
        )
        assert program.stdout is not None
        try:
            async with asyncio.timeout(60.0):
                yield program.stdout
        finally:
            program.kill()
            await program.wait()


async def test_the_client_of_the_readme_hears_samples_and_preload() -> None:
    heard = set[str]()
    async with lines_of(block("edge_service/bus/README.md", "python", "zenoh.open")) as lines:
        while not heard >= {"torque", "preload"}:
            heard.add((await lines.readline()).decode().split()[0])
    assert heard == {"torque", "preload"}


async def test_the_bridge_of_the_guide_prints_the_line_protocol() -> None:
    line = ""
    async with lines_of(block("guide", "python", "preload,site=")) as lines:
        while 'status="estimated"' not in line:
            line = (await lines.readline()).decode()
            assert re.match(r"preload,site=bench,machine=lfd,axis=X status=", line)
    fields = re.search(r"preload_percent=([0-9.]+),low=([0-9.]+),high=([0-9.]+) [0-9]{19}$", line)
    assert fields
    value, low, high = map(float, fields.groups())
    assert low <= value <= high
