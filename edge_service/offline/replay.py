"""A recording through the whole service, with its last answer."""

import asyncio
from collections.abc import Callable
from pathlib import Path

from ..bus.session import Bus
from ..bus.settings import BusSettings
from ..bus.subscriber import Subscriber
from ..command_answer import Answer
from ..config import AxisConfig, EdgeConfig, load_machine
from ..config_tables import StoreConfig
from ..messages.estimate import PreloadEstimate
from ..messages.interval import printed
from ..messages.topics import PRELOAD
from ..nodes.context import NodeContext
from ..nodes.service import PIPELINE, check_service, install_stop, run_nodes


async def replay_trace(
    config: EdgeConfig,
    trace: Path,
    machine: Path,
    speed: float,
    *,
    hold: bool,
    announce: Callable[[str], None],
    axis_number: int | None = None,
) -> Answer:
    """Run every node on a recording until its end (for ever with `hold`)."""
    name = load_machine(machine).axis.name
    settings: dict[str, object] = {"path": str(trace), "speed": speed, "loop": False}
    axis = AxisConfig(name=name, machine=machine, driver="replay", settings=settings)
    axis = axis.numbered(axis_number)
    config = config.model_copy(update={"axes": (axis,), "store": StoreConfig()})
    await check_service(config)
    place = config.bus
    bus = await Bus.open(BusSettings(place.endpoint, "router", zenoh_file=place.zenoh_file))
    try:
        bus.declare_alive(config.keys.alive)
        answers = bus.subscribe(config.keys.key(name, PRELOAD), PRELOAD)
        following = asyncio.create_task(_follow(answers))
        await run_nodes(
            NodeContext(config, bus, announce, keeps_estimates=False, is_replay=not hold),
            PIPELINE,
            install_stop(),
        )
        answers.close()
        count, last = await following
    finally:
        await bus.close()
    document = {"axis": name, "estimates": count, "last": last}
    if last is None:
        return Answer(f"axis {name}: the recording gave no interval", document)
    lines = [f"axis {name}: {count} estimates, status {last.status.value} at {last.time_s:.1f} s"]
    if last.preload_percent is not None:
        assert last.low is not None and last.high is not None
        value, low, high = printed(last.preload_percent, last.low, last.high, 2)
        lines.append(f"preload {value} % ({low} to {high})")
    if last.drag_torque_nm is not None:
        drag = last.drag_torque_nm
        lines.append(f"drag torque {drag.value:.3e} N m ({drag.low:.3e} to {drag.high:.3e})")
    return Answer("\n".join([*lines, *last.reasons]), document)


async def _follow(answers: Subscriber[PreloadEstimate]) -> tuple[int, PreloadEstimate | None]:
    """Number of estimates and the last of them, once the subscriber is closed."""
    count, last = 0, None
    async for _, _, estimate in answers:
        count, last = count + 1, estimate
    return count, last
