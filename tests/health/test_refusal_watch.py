"""Refused payloads are told of, and telling of them floods nothing."""

from collections import Counter

from edge_service.health.components import RefusalWatch

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS


def test_what_is_refused_is_told_once_with_its_key_and_reasons() -> None:
    watch = RefusalWatch()
    refused = Counter({("a/X/raw", "malformed"): 3, ("a/X/raw", "rival"): 1})
    (event,) = watch.tick(refused, START_NS)
    assert event.text == "4 payloads on a/X/raw were refused (malformed, rival): who sends them?"
    assert watch.tick(refused, START_NS + NS) == ()


def test_a_flood_of_refusals_is_told_every_ten_minutes() -> None:
    watch, told = RefusalWatch(), []
    for second in range(3600):
        refused = Counter({("k", "flooded"): 1000 * (second + 1)})
        told += watch.tick(refused, START_NS + second * NS)
    assert len(told) == 6
    assert sum(int(event.data["refused"] or 0) for event in told) == 3_001_000


def test_overtaken_payloads_are_not_told() -> None:
    assert RefusalWatch().tick(Counter({("k", "late"): 5}), START_NS) == ()


def test_many_keys_are_told_a_few_at_a_time() -> None:
    refused = Counter((f"k{number}", "foreign") for number in range(33))
    watch = RefusalWatch()
    counts = [len(watch.tick(refused, START_NS + second * NS)) for second in range(10)]
    assert max(counts) == 4
    assert sum(counts) == 33
