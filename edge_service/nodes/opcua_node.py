"""Answers about all axes in an OPC UA server."""

from functools import partial

from ..bus.opcua.application import OpcuaSettings
from ..bus.opcua.server import AnswerServer
from .outputs.latest_answers import LatestAnswers
from .outputs.listening import listen
from .outputs.opcua_rights import opcua_settings
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter

BUILD_S = 120.0
"""Longest time in which the address space is there, on a slow and busy machine."""
SHOW_PERIOD_S = 0.5


async def run(context: NodeContext) -> None:
    """Serve until cancelled. Raises ConfigError for what cannot work."""
    settings, latest = opcua_settings(context.config), LatestAnswers(context)
    reporter = Reporter(context, "opcua")
    async with reporter.running() as tasks:
        latest.follow(tasks)
        tasks.start("server", partial(_serve, settings, latest, reporter))
        await context.forever()


async def _serve(
    settings: OpcuaSettings, latest: LatestAnswers, reporter: Reporter, heart: Heartbeat
) -> None:
    """Build, listen, and show what is known now again and again."""
    build = partial(AnswerServer.built, settings, latest.now())
    server = await heart.in_thread(build, limit_s=BUILD_S)
    reporter.readings = lambda: {"sessions": server.sessions}
    try:
        await listen(server.start, f"{settings.host}:{settings.port}", reporter, heart)
        while True:
            await server.show(latest.now())
            await heart.sleep(SHOW_PERIOD_S)
    finally:
        await server.stop()
