"""The bridge that the operators' guide shows passes estimates on."""

import asyncio
import re
import subprocess
import sys

from .documents import block
from .nodes.conftest import config_of, running


async def test_the_bridge_of_the_readme_prints_the_line_protocol() -> None:
    source = block("guide", "python", "preload,site=")
    config = config_of("simulated", {"scenario": "healthy", "speed": 20.0})
    async with running(config, ("acquire", "downsample", "estimate")) as service:
        bridge = await asyncio.create_subprocess_exec(
            sys.executable, "-I", "-c", source, service.bus.endpoint, stdout=subprocess.PIPE
        )
        assert bridge.stdout is not None
        try:
            async with asyncio.timeout(60.0):
                while True:
                    line = (await bridge.stdout.readline()).decode()
                    assert re.match(r"preload,site=bench,machine=lfd,axis=X status=", line)
                    if 'status="estimated"' in line:
                        break
        finally:
            bridge.kill()
            await bridge.wait()
    fields = re.search(r"preload_percent=([0-9.]+),low=([0-9.]+),high=([0-9.]+) [0-9]{19}$", line)
    assert fields
    value, low, high = map(float, fields.groups())
    assert low <= value <= high
