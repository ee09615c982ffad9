"""Quality of one sample: good, uncertain or bad, with a reason."""

from enum import IntEnum, StrEnum

import numpy as np
import numpy.typing as npt

Qualities = npt.NDArray[np.uint8]
"""One code of `Quality` per sample, shape (n,)."""

_UNCERTAIN_FROM, _BAD_FROM = 64, 128


class Level(StrEnum):
    """Usability of a sample to a reader: use it, use it with doubt, not use it."""

    GOOD = "good"
    UNCERTAIN = "uncertain"
    BAD = "bad"


class Quality(IntEnum):
    """Code of one sample. A bad sample's value is NaN: nobody can read it by mistake."""

    GOOD = 0

    SOURCE_UNCERTAIN = 64  # the device itself says so
    LATE_READ = 65  # the read took so long that its time is doubtful
    OVERFLOW = 66  # the device's queue ran over: samples before this one are lost
    NO_SOURCE_TIME = 67  # the device gave no time; that of its arrival stands in

    NO_VALUE = 128  # nothing has been received yet, or no longer
    NO_REPLY = 129  # the device did not answer in time, or hung up
    DEVICE_EXCEPTION = 130  # the device refused with an exception
    MALFORMED = 131  # a reply that contradicts the protocol or the request
    NOT_A_NUMBER = 132  # NaN, infinite or no number at all
    OUT_OF_RANGE = 133  # outside what the configuration calls possible
    SOURCE_BAD = 134  # the device itself says so
    STALE = 135  # the device repeats old values
    WRONG_CONSTANT = 136  # a value that never changes reads otherwise: wrong map or word order

    @property
    def level(self) -> Level:
        """Good, uncertain or bad."""
        if self < _UNCERTAIN_FROM:
            return Level.GOOD
        return Level.UNCERTAIN if self < _BAD_FROM else Level.BAD


def is_bad(codes: Qualities) -> npt.NDArray[np.bool_]:
    """Mask of the samples that must not be read, shape (n,)."""
    return np.asarray(codes >= _BAD_FROM)


def is_uncertain(codes: Qualities) -> npt.NDArray[np.bool_]:
    """Mask of the samples that may be read with doubt only, shape (n,)."""
    return np.asarray((codes >= _UNCERTAIN_FROM) & (codes < _BAD_FROM))
