"""Processor time of one request for `/preload`, beside that of an application that does nothing."""

import http.client
import sys
import time

from .process_meter import Program, ServiceProcess, cpu_s

IDLE_S = 3.0
PATH = "/api/v1/axes/A1/preload"
BARE = """
import asyncio, socket, sys, uvicorn
BODY = sys.argv[1].encode()
HEADERS = [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(BODY))]
async def app(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": HEADERS})
    await send({"type": "http.response.body", "body": BODY})
listener = socket.create_server(("127.0.0.1", 0))
print(listener.getsockname()[1], flush=True)
config = uvicorn.Config(app, log_level="critical", lifespan="off")
asyncio.run(uvicorn.Server(config).serve([listener]))
"""
"""uvicorn with an answer of the same length, ready in memory."""


def request_costs_us(service: ServiceProcess, host: str, port: int, n: int) -> tuple[float, float]:
    """Processor time of a request to the service and to the bare application, us.

    What the service does meanwhile for its axes is measured in an equal time before, and taken off.
    """
    body, ours_us = _cost_us(service.pid, host, port, n)
    with Program(sys.executable, "-c", BARE, body.decode()) as bare:
        _, bare_us = _cost_us(bare.pid, "127.0.0.1", int(bare.hear()), n)
    return ours_us, bare_us


def _cost_us(pid: int, host: str, port: int, count: int) -> tuple[bytes, float]:
    """Body of the answer, and processor time of a request over a connection that is kept, us."""
    connection = http.client.HTTPConnection(host, port, timeout=10.0)
    try:
        for _ in range(20):
            body = _asked(connection)
        begun_s, before_s = time.monotonic(), cpu_s(pid)
        time.sleep(IDLE_S)
        idle = (cpu_s(pid) - before_s) / (time.monotonic() - begun_s)
        begun_s, before_s = time.monotonic(), cpu_s(pid)
        for _ in range(count):
            body = _asked(connection)
        span_s, spent_s = time.monotonic() - begun_s, cpu_s(pid) - before_s
        return body, 1e6 * max(0.0, spent_s - idle * span_s) / count
    finally:
        connection.close()


def _asked(connection: http.client.HTTPConnection) -> bytes:
    connection.request("GET", PATH)
    answer = connection.getresponse()
    body = answer.read()
    if answer.status != 200:
        raise ConnectionError(f"{PATH} answers {answer.status}")
    return body
