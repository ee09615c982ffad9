"""JSON schemas of every payload: what is on the bus, in events and in webhooks."""

from typing import Any

from fastapi import APIRouter

from ...messages.topics import TOPICS

schema_router = APIRouter(prefix="/api/v1", tags=["service"])


@schema_router.get("/schemas")
async def schemas() -> dict[str, Any]:
    """JSON schema of every JSON payload, and the columns of every binary block, by name."""
    return {topic.payload: topic.codec.description() for topic in TOPICS.values()}
