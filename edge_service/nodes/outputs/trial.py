"""Test message to one output, past all that waits."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import uuid4

from ...bus.spool.message import Message
from ...clock import now_ns
from ...config import ConfigError, EdgeConfig
from ...messages.event import Event, Severity
from .ordered import OrderedOutput
from .registry import OPENERS
from .reply import Outcome, Reply


@dataclass(frozen=True, slots=True)
class Trial:
    """Result of a test: the address, and what is wrong; "" if nothing is."""

    place: str
    problem: str


async def try_output(config: EdgeConfig, name: str) -> Trial:
    """Send a test message as events are sent, once. Raises ConfigError."""
    with TemporaryDirectory() as folder:
        buffer = {"buffer": Path(folder) / "trial.sqlite"}
        tables = {name: getattr(config, name).model_copy(update=buffer)}
        used = config.model_copy(update=tables)
        output = await OPENERS[name](used, lambda _problem: None, lambda _axis: None)
        if output is None:
            raise ConfigError(f"{name}: nothing can be sent, because its address is missing")
        try:
            reply = await _sent(output)
        finally:
            output.spool.close()
    taken = reply.outcome is Outcome.TAKEN
    return Trial(output.place, reply.reason or ("" if taken else reply.outcome))


async def _sent(output: OrderedOutput) -> Reply:
    said = "a test message of `edge-service send-test`; nothing has happened"
    event = Event(axis="", kind="test", severity=Severity.INFO, message=said, time_ns=now_ns())
    return await output.send([Message(1, "/test", output.payload(event), uuid4().hex)])
