"""A motion as an NC program of a SINUMERIK: feeds, dwells and exact stops.

Words from the Programming Manual Fundamentals, SINUMERIK 840D sl / 828D: G1 with F in mm/min (G94,
G710), G4 F dwell in seconds, G60 G601 exact stop, SOFT jerk limitation, and ACC as a percentage of
the axis' acceleration in the machine data.
"""

import re
from collections.abc import Iterable, Iterator

from .limits import MotionError, MotionLimits
from .route import Segment
from .segments import Dwell, Move

_MM_PER_M = 1e3
_SECONDS_PER_MINUTE = 60.0


def nc_blocks(
    name: str, axis: str, segments: Iterable[Segment], limits: MotionLimits
) -> Iterator[str]:
    """Blocks of the program, from the approach to `limits.low_m` to M30; positions as the table's.

    Raises:
        MotionError: a segment is neither a move nor a dwell, or `axis` is no axis of a controller.
    """
    if not re.fullmatch(r"[A-Z][A-Z0-9]{0,7}", axis):
        raise MotionError(
            f"axis.name: {axis!r} is not an axis of an NC program; expected X, Y1, ..."
        )
    position_m = limits.low_m
    percent = 100.0
    yield "G90 G94 G710 G60 G601 SOFT"
    yield f"ACC[{axis}]=100"
    yield _feed(axis, position_m, limits.rapid_m_s)
    for segment in segments:
        if isinstance(segment, Dwell):
            if segment.duration_s > 0.0:
                yield f"G4 F{segment.duration_s:.4g}"
            continue
        if not isinstance(segment, Move):
            raise MotionError(
                f"{name}: vibrates, which an NC program cannot express; write a .csv file"
            )
        wanted = max(100.0 * segment.acceleration_m_s2 / limits.acceleration_m_s2, 1.0)
        if wanted != percent:
            percent = wanted
            yield f"ACC[{axis}]={percent:.4g}"
        position_m += segment.distance_m
        yield _feed(axis, position_m, segment.speed_m_s)
    yield "M30"


def _feed(axis: str, position_m: float, speed_m_s: float) -> str:
    feed = speed_m_s * _MM_PER_M * _SECONDS_PER_MINUTE
    return f"G1 {axis}={position_m * _MM_PER_M:.5f} F{feed:.6g}"
