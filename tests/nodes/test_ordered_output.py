"""Pauses of outputs: shortened by chance, so that many services do not return at one moment."""

import asyncio

from edge_service.nodes.outputs.ordered import SHORTENED, jittered


async def test_no_two_services_pause_alike_and_none_longer_than_announced() -> None:
    now_s = asyncio.get_running_loop().time()
    ends = []
    for _ in range(200):
        async with jittered(60.0) as limit:
            ends.append((limit.when() or 0.0) - now_s)
    assert len(set(ends)) == 200
    assert 60.0 * (1.0 - SHORTENED) <= min(ends) < 48.0
    assert 57.0 < max(ends) <= 61.0  # and the time that the loop took
