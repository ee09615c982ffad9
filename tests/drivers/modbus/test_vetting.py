"""Replies are believed only where every field agrees: a dozen hostile frames, and 100,000 more."""

import random
from contextlib import suppress

import pytest

from drivers.modbus.link import WrongReplyError, vet

ASKED = bytes.fromhex("0007 0000 0006 01 03 0010 0002")
GOOD = bytes.fromhex("0007 0000 0007 01 03 04 4049 0fdb")
REFUSED = bytes.fromhex("0007 0000 0003 01 83 02")
LATE = bytes.fromhex("0006 0000 0007 01 03 04 0000 0000")

WRONG: dict[str, str] = {
    "another protocol": "0007 0001 0007 01 03 04 4049 0fdb",
    "length zero": "0007 0000 0000 01 03 04 4049 0fdb",
    "length of no reply": "0007 0000 0002 01 03",
    "endless length": "0007 0000 ffff 01 03 04 4049 0fdb",
    "another unit": "0007 0000 0007 02 03 04 4049 0fdb",
    "another function": "0007 0000 0007 01 04 04 4049 0fdb",
    "exception of another function": "0007 0000 0003 01 84 02",
    "exception without a code": "0007 0000 0002 01 83",
    "exception too long": "0007 0000 0004 01 83 02 00",
    "one register too few": "0007 0000 0005 01 03 02 4049",
    "one register too many": "0007 0000 0009 01 03 06 4049 0fdb 0000",
    "byte count too small": "0007 0000 0007 01 03 02 4049 0fdb",
    "byte count too large": "0007 0000 0007 01 03 06 4049 0fdb",
    "odd byte count": "0007 0000 0007 01 03 05 4049 0fdb",
    "half a register more": "0007 0000 0008 01 03 05 4049 0fdb 00",
    "text": "48 54 54 50 2f 31 2e 31 20 34 30 30",
    "a write acknowledged": "0007 0000 0006 01 10 0000 0002",
}
WAITING: dict[str, str] = {
    "nothing": "",
    "cut in the header": "0007 0000 00",
    "cut in the data": "0007 0000 0007 01 03 04 4049",
    "another transaction": "0008 0000 0007 01 03 04 4049 0fdb",
    "transaction zero": "0000 0000 0007 01 03 04 4049 0fdb",
    "a late reply alone": LATE.hex(),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_contradicts_the_request_is_wrong(name: str) -> None:
    with pytest.raises(WrongReplyError, match=r"^[^\n]+$"):
        vet(bytes.fromhex(WRONG[name]), ASKED)


@pytest.mark.parametrize("name", WAITING)
def test_what_may_still_become_a_reply_is_awaited(name: str) -> None:
    assert vet(bytes.fromhex(WAITING[name]), ASKED) == b""


@pytest.mark.parametrize("reply", [GOOD, REFUSED])
@pytest.mark.parametrize("before", [b"", LATE, LATE + LATE])
@pytest.mark.parametrize("after", [b"", b"\x00", LATE, GOOD, b"garbage"])
def test_the_reply_is_found_between_others(reply: bytes, before: bytes, after: bytes) -> None:
    assert vet(before + reply + after, ASKED) == reply


def believable(stream: bytes) -> bytes | None:
    """The reply of a stream by the letter of the specification, or None: frame after frame."""
    while len(stream) >= 9:
        fields = [int.from_bytes(stream[i : i + 2], "big") for i in (0, 2, 4)]
        size = 6 + fields[2]
        frame, stream = stream[:size], stream[size:]
        if fields[1] != 0 or not 3 <= fields[2] <= 254 or len(frame) < size:
            return None
        if fields[0] == 7:
            registers = frame[6] == 1 and frame[7] == 3 and frame[8] == 4 and size == 13
            exception = frame[6] == 1 and frame[7] == 0x83 and size == 9
            return frame if registers or exception else None
    return None


def mutate(dice: random.Random) -> bytes:
    """Frames that are nearly right: bytes changed, lost, added, frames merged and cut."""
    parts = [bytearray(dice.choice([GOOD, GOOD, REFUSED, LATE])) for _ in range(dice.randint(1, 3))]
    for part in parts:
        for _ in range(dice.choice([0, 0, 1, 1, 2, 5])):
            place = dice.randrange(len(part)) if part else 0
            match dice.randrange(4):
                case 0 if part:
                    part[place] = dice.choice([0, 1, 2, 3, 4, 5, 7, 0x80, 0x83, 0xFF])
                case 1 if part:
                    del part[place]
                case 2:
                    part.insert(place, dice.randrange(256))
                case _:
                    part[place:] = dice.randbytes(dice.randrange(8))
    return b"".join(bytes(part) for part in parts)


def test_100_000_generated_streams_are_judged_by_the_letter() -> None:
    dice = random.Random(5)
    for _ in range(100_000):
        stream = mutate(dice)
        expected = believable(stream)
        with suppress(WrongReplyError):
            assert vet(stream, ASKED) == (expected or b""), stream.hex()
            continue
        assert expected is None, stream.hex()
