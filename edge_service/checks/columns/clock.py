"""The clock of a recording: which column, in which unit, how even, and where it starts anew."""

import numpy as np

from ...messages.channels import TIME
from ...messages.samples import Floats
from ...recordings.columns import ROW_NUMBER
from ..sampling import clock_of
from .guess import Choice, Known, Understanding
from .names import ColumnName, Quantity
from .relations import changes, proportion, travelled

EDGE_PERIOD_S = 0.002
"""Cycle of Industrial Edge's high-frequency data (Siemens, SINUMERIK Connector)."""
_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_RATES_HZ = (10.0, 20_000.0)
_ROUND = 0.05
_SURE = 0.9
_FEW_ROWS = 5
"""Rows of one window where rows may be missing unseen."""
_NICE_S = tuple(
    base * 10.0**-power for power in range(5) for base in (1.0, 2.0, 2.5, 4.0, 5.0, 8.0)
)


def find_clock(
    names: list[ColumnName], values: dict[str, Floats], known: Known, found: Understanding
) -> Floats | None:
    """Time of every sample, s; None where nothing tells it. Says and asks what there is to it."""
    for quantity in _order(names, known):
        for each in names:
            if each.quantity is quantity:
                scale = _scale(each, values[each.name], known, found)
                if scale is not None:
                    found.columns[TIME] = Choice(each.name, scale)
                    return scale * values[each.name]
    return _by_rows(names, values, known, found)


def _order(names: list[ColumnName], known: Known) -> tuple[Quantity, ...]:
    """Kinds of clocks, the better one first; a period that is given outdoes one that is assumed."""
    if known.period_s is None:
        return Quantity.TIME, Quantity.COUNTER
    if any("|" in each.name for each in names):
        return (Quantity.COUNTER,)
    return Quantity.COUNTER, Quantity.TIME


def _scale(each: ColumnName, values: Floats, known: Known, found: Understanding) -> float | None:
    steps = np.diff(values)
    forward = steps[steps > 0.0]
    if forward.size == 0:
        found.say(TIME, f"{each.name!r} never increases, so it is no clock")
        return None
    usual = float(np.median(forward))
    if each.quantity is Quantity.COUNTER:
        return _counter(each, known, found)
    if each.unit in _TIME_UNITS:
        scale = _TIME_UNITS[each.unit]
        why = "by its name"
    else:
        scale, why = _by_size(usual)
    unit = next(unit for unit, factor in _TIME_UNITS.items() if factor == scale)
    found.say(
        TIME,
        f"{each.name!r} in {unit} ({why}): {clock_of([scale * values]).as_text()}",
        assumed=why.startswith("assumed"),
    )
    return scale


def _by_size(usual: float) -> tuple[float, str]:
    """Unit in which the samples come at a rate that machines are recorded at."""
    fitting = [
        factor
        for factor in _TIME_UNITS.values()
        if _RATES_HZ[0] <= 1.0 / (factor * usual) <= _RATES_HZ[1] * (1.0 + 1e-9)
    ]
    if len(fitting) == 1:
        return fitting[0], "the only unit that gives a rate between 10 Hz and 20 kHz"
    if fitting:
        return fitting[0], "assumed: finer units would also give a usual rate"
    return 1.0, "assumed: no unit gives a usual rate"


def _counter(each: ColumnName, known: Known, found: Understanding) -> float | None:
    if known.period_s is not None:
        found.say(TIME, f"{each.name!r} counts samples of {known.period_s:g} s, as given")
        return known.period_s
    if each.name == "CYCLE":
        found.say(
            TIME,
            f"{each.name!r} counts position-control cycles of 2 ms, as Industrial Edge has "
            "them by default",
            assumed=True,
        )
        return EDGE_PERIOD_S
    return None


def _by_rows(
    names: list[ColumnName], values: dict[str, Floats], known: Known, found: Understanding
) -> Floats | None:
    """Time from the number of the row, where the length of a sample is known or can be found."""
    rows = np.arange(len(next(iter(values.values()))), dtype=np.float64)
    period_s, why = known.period_s, "as given"
    if period_s is None:
        period_s, why = _from_speed(names, values, rows), "from the speed beside the position"
    if period_s is None and any("|" in each.name for each in names):
        period_s, why = EDGE_PERIOD_S, "assumed: Industrial Edge records every 2 ms by default"
    if period_s is None:
        found.ask("--period", "Length of a sample, s", "no column holds the time")
        return None
    found.columns[TIME] = Choice(ROW_NUMBER, period_s)
    words = f"no column holds it; a row is {period_s:.4g} s ({why})"
    found.say(TIME, words, assumed=why.startswith("assumed"))
    return rows * period_s


def _from_speed(names: list[ColumnName], values: dict[str, Floats], rows: Floats) -> float | None:
    """Length of a sample if a position and a speed of one length unit stand beside each other."""
    speeds = [each for each in names if each.quantity is Quantity.SPEED]
    positions = [each for each in names if each.quantity is Quantity.POSITION]
    if not speeds or not positions:
        return None
    windows = np.column_stack([rows[:-_FEW_ROWS:_FEW_ROWS], rows[_FEW_ROWS::_FEW_ROWS]]).astype(int)
    speed, position = values[speeds[0].name], values[positions[0].name]
    link = proportion(changes(position, windows), travelled(speed, rows, windows))
    if link is None or link.correlation < _SURE or link.factor <= 0.0:
        return None
    nearest = min(_NICE_S, key=lambda nice: abs(nice / link.factor - 1.0))
    close = abs(nearest / link.factor - 1.0) < max(_ROUND, 3.0 * link.sigma / link.factor)
    return nearest if close else link.factor
