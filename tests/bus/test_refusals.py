"""Hostile payloads: each is refused, counted, and costs nobody else anything."""

from dataclasses import replace

import numpy as np
import pytest

from edge_service.bus.reception import MOST_JUMP, Arrival, KeyRings, Refusal, Sender
from edge_service.bus.session import Bus
from edge_service.messages.codec import Header
from edge_service.messages.keys import MachineKeys
from edge_service.messages.samples import TORQUE, SampleFrame
from edge_service.messages.topics import RAW

KEYS = MachineKeys("site", "machine")
FRAME = SampleFrame(np.array([0.0, 1e-3]), {TORQUE: np.array([0.1, 0.2])})
GENUINE = Header(7, 1, 0, 0)
HOSTILE = {
    Refusal.FOREIGN: ("Q", RAW.encode("Q", GENUINE, FRAME)),
    Refusal.OVERSIZED: ("X", b"[" * (RAW.most_bytes + 1)),
    Refusal.MALFORMED: ("X", b"[" * RAW.most_bytes),
    Refusal.MISPLACED: ("X", RAW.encode("Y", GENUINE, FRAME)),
    Refusal.RIVAL: ("X", RAW.encode("X", replace(GENUINE, boot_epoch=2**62), FRAME)),
    Refusal.LATE: ("X", RAW.encode("X", replace(GENUINE, sequence=0), FRAME)),
}
"""Axis of the key, and payload, by the reason for which it is refused."""


@pytest.mark.parametrize("reason", HOSTILE)
async def test_a_hostile_payload_is_refused_and_counted(router: Bus, reason: Refusal) -> None:
    keys = {KEYS.key(axis, RAW) for axis in "XY"}
    subscriber = router.subscribe(KEYS.all_axes(RAW), RAW, keys=keys)
    axis, payload = HOSTILE[reason]
    for name in ("X", "Y"):
        router._session.put(KEYS.key(name, RAW), RAW.encode(name, GENUINE, FRAME))
    router._session.put(KEYS.key(axis, RAW), payload)
    after = replace(GENUINE, sequence=8)
    router._session.put(KEYS.key("X", RAW), RAW.encode("X", after, FRAME))
    subscriber.close()
    heard = [(axis, header) async for axis, header, _ in subscriber]
    assert sorted(heard, key=repr) == [("X", GENUINE), ("X", after), ("Y", GENUINE)]
    assert subscriber.refusals.counts() == {reason: 1}
    router.subscribe(KEYS.all_axes(RAW), RAW)
    assert router.refused() == {("raw", reason): 1}


async def test_what_could_not_be_decoded_is_refused_in_its_process(router: Bus) -> None:
    subscriber = router.subscribe(KEYS.all_axes(RAW), RAW)
    publisher = router.publisher(KEYS.key("X", RAW), RAW, "X")
    for times in ([], [np.nan], [0.0, np.inf], [1e300], [0.0]):
        publisher.publish(SampleFrame(np.array(times), {}), 0)
    subscriber.close()
    assert [header.sequence async for _, header, _ in subscriber] == [4]
    assert subscriber.refusals.counts() == {Refusal.MALFORMED: 4}


async def test_a_flood_on_one_key_pushes_nothing_out_of_another(router: Bus) -> None:
    subscriber = router.subscribe(KEYS.all_axes(RAW), replace(RAW, most_hz=10.0), depth=4)
    router._session.put(KEYS.key("Y", RAW), RAW.encode("Y", GENUINE, FRAME))
    for number in range(1000):
        payload = RAW.encode("X", replace(GENUINE, sequence=number), FRAME)
        router._session.put(KEYS.key("X", RAW), payload)
    subscriber.close()
    heard = [axis async for axis, _, _ in subscriber]
    assert (heard.count("Y"), heard.count("X")) == (1, 4)
    assert subscriber.refusals.counts()[Refusal.FLOODED] >= 900


def test_keys_are_read_in_turn() -> None:
    rings = KeyRings(depth=10, most_hz=100.0)
    for key in ("a", "a", "a", "b"):
        assert rings.admits(key, 0.0)
        rings.put(Arrival(key, b"", 0.0))
    order = []
    while (arrival := rings.take()) is not None:
        order.append(arrival.key)
    assert order == ["a", "b", "a", "a"]


def test_a_rate_is_earned_again() -> None:
    rings = KeyRings(depth=10, most_hz=2.0)
    admitted = [rings.admits("a", at_s) for at_s in (0.0, 0.0, 0.0, 0.5, 0.5, 9.0, 9.0, 9.0)]
    assert admitted == [True, True, False, True, False, True, True, False]


def heard(sender: Sender, *payloads: tuple[int, int, float]) -> list[Refusal | None]:
    """Judgements on (boot epoch, sequence, arrival in s)."""
    return [sender.judge(Header(number, boot, 0, 0), at_s) for boot, number, at_s in payloads]


def test_a_rival_is_not_heard_while_the_publisher_speaks() -> None:
    payloads = [(boot, number, 0.1 * number) for number in range(100) for boot in (5, 9, 1)]
    judged = heard(Sender(0.5), *payloads)
    assert judged == [None, Refusal.RIVAL, Refusal.RIVAL] * 100


@pytest.mark.parametrize("number", [1 + MOST_JUMP, 2**60, 2**63 - 1])
def test_a_forged_number_is_not_believed(number: int) -> None:
    judged = heard(Sender(0.5), (1, 0, 0.0), (1, number, 0.1), (1, 1, 0.2))
    assert judged == [None, Refusal.RIVAL, None]


def test_what_was_believed_wrongly_blinds_for_a_moment_only() -> None:
    sender = Sender(0.5)
    judged = heard(sender, (1, 0, 0.0), (1, 500, 0.1), (1, 1, 0.2), (1, 5, 0.7), (1, 6, 0.8))
    assert judged == [None, None, Refusal.LATE, None, None]


@pytest.mark.parametrize("boot", [0, 9])
def test_another_publisher_is_heard_after_a_silence(boot: int) -> None:
    sender = Sender(0.5)
    assert heard(sender, (1, 7, 0.0), (boot, 0, 0.6), (boot, 1, 0.7)) == [None] * 3
    assert (sender.restarts, sender.lost) == (1, 0)


async def test_publishers_of_one_key_in_one_process_are_one(router: Bus) -> None:
    subscriber = router.subscribe(KEYS.all_axes(RAW), RAW)
    for _ in range(3):
        router.publisher(KEYS.key("X", RAW), RAW, "X").publish(FRAME, 0)
    subscriber.close()
    assert [header.sequence async for _, header, _ in subscriber] == [0, 1, 2]
