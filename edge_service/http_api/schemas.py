"""JSON schemas of every payload: what is on the bus, in events and in webhooks."""

from typing import Any

from fastapi import APIRouter

from ..messages.alarm import Command
from ..messages.codec import FEATURE_UNITS, MAGIC
from ..messages.estimate import Frozen, PreloadEstimate
from ..messages.event import Event
from ..messages.health import AxisHealth, ComponentHealth
from ..messages.topics import (
    BLOCK_ENCODING,
    COMMAND,
    EVENT,
    FEAT,
    HEALTH,
    PRELOAD,
    STATUS,
    TOPICS,
    VIB,
)
from ..messages.vibration import VibrationFeatures

schema_router = APIRouter(prefix="/api/v1", tags=["service"])

_MODELS: dict[str, type[Frozen]] = {
    PRELOAD.payload: PreloadEstimate,
    HEALTH.payload: AxisHealth,
    EVENT.payload: Event,
    COMMAND.payload: Command,
    STATUS.payload: ComponentHealth,
    VIB.payload: VibrationFeatures,
}
_BLOCKS = {topic.payload for topic in TOPICS.values() if topic.encoding == BLOCK_ENCODING}
_HEADER = ("sequence", "boot_epoch", "source_time_ns", "monotonic_time_ns")


@schema_router.get("/schemas")
async def schemas() -> dict[str, Any]:
    """JSON schema of every JSON payload, and the columns of every binary block, by name."""
    return {topic.payload: payload_schema(topic.payload) for topic in TOPICS.values()}


def payload_schema(payload: str) -> dict[str, Any]:
    """Schema of one payload; binary blocks are described by their header and columns."""
    if payload in _BLOCKS:
        units = FEATURE_UNITS if payload == FEAT.payload else {"time_s": "s"}
        return {
            "title": payload,
            "encoding": MAGIC.decode(),
            "header": {"schema": {"const": payload}} | _integers(),
            "columns": units,
        }
    schema = _MODELS[payload].model_json_schema()
    own = {"schema": {"const": payload}, "axis": {"type": ["string", "null"]}} | _integers()
    schema["properties"] = own | schema["properties"]
    schema["required"] = [*dict.fromkeys([*own, *schema.get("required", [])])]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema


def _integers() -> dict[str, Any]:
    return {name: {"type": "integer"} for name in _HEADER}
