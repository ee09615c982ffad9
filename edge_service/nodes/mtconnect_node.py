"""Answers about all axes for agents of MTConnect."""

from functools import partial

from ..bus.mtconnect.adapter import Adapter
from ..clock import now_ns
from ..config import ConfigError
from ..config_tables import MtconnectConfig
from .outputs.latest_answers import LatestAnswers
from .outputs.listening import listen
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext, Reporter

SHOW_PERIOD_S = 0.5


async def run(context: NodeContext) -> None:
    """Serve until cancelled. Raises ConfigError for what cannot work."""
    settings = context.config.mtconnect
    if settings is None:
        raise ConfigError("mtconnect: missing; the node needs an [mtconnect] table")
    latest = LatestAnswers(context)
    reporter = Reporter(context, "mtconnect")
    async with reporter.running() as tasks:
        latest.follow(tasks)
        tasks.start("adapter", partial(_serve, settings, latest, reporter))
        await context.forever()


async def _serve(
    settings: MtconnectConfig, latest: LatestAnswers, reporter: Reporter, heart: Heartbeat
) -> None:
    """Listen, and show what is known now again and again."""
    adapter = Adapter(settings.clients)
    reporter.readings = lambda: {"clients": adapter.clients}
    reporter.counters = lambda: {"cut_off": adapter.cut_off}
    try:
        adapter.show(latest.now(), now_ns())
        start = partial(adapter.start, settings.host, settings.port)
        await listen(start, f"{settings.host}:{settings.port}", reporter, heart)
        while True:
            adapter.show(latest.now(), now_ns())
            await heart.sleep(SHOW_PERIOD_S)
    finally:
        adapter.stop()
