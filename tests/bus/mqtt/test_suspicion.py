"""A message is set aside only if the broker breaks off at it before and after it takes another."""

import random

import pytest

from edge_service.bus.mqtt.suspicion import MOST_BROKEN, Suspicion
from edge_service.bus.spool.message import Message


@pytest.mark.parametrize("seed", range(50))
def test_only_poison_is_set_aside_and_all_else_arrives_in_order(seed: int) -> None:
    """Brokers that are sick for a while, and any share of messages at which they break off."""
    dice = random.Random(seed)
    share = dice.choice((0.0, 0.05, 0.4))
    waiting = [Message(number, "X/x", b"", f"{number}") for number in range(60)]
    poison = {each.key for each in waiting[:40] if dice.random() < share}
    suspicion, arrived, dead = Suspicion(), [], []
    sick_s, connections = dice.choice((0, 30)), 0
    while waiting and connections < 5000:
        connections += 1
        broken = False
        while waiting and not broken:
            first, chosen = waiting[0], suspicion.choose(waiting[:64])
            for message in chosen:
                broken = broken or message.key in poison or connections <= sick_s
                if not broken:
                    arrived.append(message.number)
                    waiting.remove(message)
            if not broken:
                suspicion.taken()
            elif suspicion.broke():
                waiting.remove(first)
                dead.append(first.key)
    assert waiting == []
    assert set(dead) == poison
    assert sorted(arrived) == [number for number in range(60) if f"{number}" not in poison]
    recovers_at_another = sick_s > MOST_BROKEN
    assert arrived == sorted(arrived) or recovers_at_another


def test_a_sick_broker_is_never_in_a_hurry_for_long() -> None:
    suspicion = Suspicion()
    waiting = [Message(number, "X/x", b"", f"{number}") for number in range(100)]
    hurried = []
    for _ in range(2000):
        suspicion.choose(waiting)
        assert not suspicion.broke()
        hurried.append(suspicion.hurries)
    assert not any(hurried[:MOST_BROKEN])
    assert "1" * 17 not in "".join("01"[each] for each in hurried)
