"""Doubles as SINUMERIK's servo tuning writes them: base 85 with an alphabet of its own.

Five digits are four bytes, the greatest first, and `.` is four zeros, as the `z` of Ascii85. The
alphabet avoids what XML would escape. It agrees with that of eliasrhoden/Trace-Tools (`b85.py`),
which was read from other files.
"""

import string

import numpy as np

from ...messages.samples import Floats

ALPHABET = string.digits + string.ascii_lowercase + string.ascii_uppercase
ALPHABET += "!#$`()*+-/:;=?@[]^_{|}~"
_ZEROS, _NO_DIGIT = ".", 255
_POWERS = 85 ** np.arange(4, -1, -1, dtype=np.uint64)
_DIGITS = np.full(256, _NO_DIGIT, dtype=np.uint8)
_DIGITS[np.frombuffer(ALPHABET.encode(), dtype=np.uint8)] = np.arange(85)


def doubles_from_base85(text: str) -> Floats:
    """Doubles in a text, white space aside, shape (n,).

    Raises:
        ValueError: one line; a character that is no digit, or no whole number of doubles.
    """
    plain = "".join(text.split()).replace(_ZEROS, ALPHABET[0] * 5)
    digits = _DIGITS[np.frombuffer(plain.encode("latin-1", "replace"), dtype=np.uint8)]
    if len(digits) % 10:
        raise ValueError("no whole number of doubles")
    if np.any(digits == _NO_DIGIT):
        raise ValueError("a character that is no digit of base 85")
    words = digits.reshape(-1, 5).astype(np.uint64) @ _POWERS
    if np.any(words > 0xFFFF_FFFF):
        raise ValueError("five digits that are more than four bytes")
    values: Floats = np.frombuffer(words.astype(">u4").tobytes(), ">f8").astype(np.float64)
    return values
