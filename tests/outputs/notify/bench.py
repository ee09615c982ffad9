"""A receiver of HTTP for the behaviour suite, told by apprise's json://."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from edge_service.outputs.base import Output

from ...drivers.bench import free_port
from ..bench import SECRET, OutputBench, output, silent_peer
from .receiver import Receiver


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[OutputBench]:
    receiver, refuser = Receiver(free_port()), Receiver(free_port(), status=403)
    await receiver.start()
    await refuser.start()

    def make(port: int = receiver.port) -> Output:
        urls = folder / f"{port}.urls"
        urls.write_text(f"# people\njson://edge:{SECRET}@127.0.0.1:{port}/{SECRET}?rto=1&cto=1\n")
        urls.chmod(0o600)
        return output("notify", {"urls_file": str(urls)})

    async def heard() -> bool:
        return any("preload at 47 %" in each["message"] for each in receiver.taken)

    async with silent_peer() as silent:
        yield OutputBench(
            make,
            heard,
            receiver.stop,
            receiver.start,
            hanging=lambda: make(silent),
            refusing=lambda: make(refuser.port),
        )
    await receiver.stop()
    await refuser.stop()
