"""The clock of a recording: which column, in which unit, how even, and where it starts anew."""

import numpy as np

from ...messages.samples import SI, TIME, ColumnMap, Floats
from ...recordings.columns import ROW_NUMBER
from ..sampling import clock_of
from .guess import Known, Understanding
from .names import ColumnName, Quantity
from .relations import changes, proportion, travelled, usual_step

EDGE_PERIOD_S = 0.002
"""Cycle of Industrial Edge's high-frequency data (Siemens, SINUMERIK Connector)."""
_TIME_UNITS = ("s", "ms", "us", "ns", "d")
_RATES_HZ = (10.0, 20_000.0)
_ROUND = 0.05
_SURE = 0.9
_MOST_REPEATED, _MOST_BACKWARDS = 0.5, 0.1
_HUNDRED_NS = 5e16, 1e18
"""Times of today as Windows counts them, in 100 ns from 1601 or from the year 1."""
_PERIOD = "Length of a sample, s"
_FEW_ROWS = 5
"""Rows of one window where rows may be missing unseen."""
_NICE_S = tuple(base * 10.0**-down for down in range(5) for base in (1.0, 2.0, 2.5, 4.0, 5.0, 8.0))


def find_clock(
    names: list[ColumnName], values: dict[str, Floats], known: Known, found: Understanding
) -> Floats | None:
    """Time of every sample, s; None where nothing tells it. Says and asks what there is to it.

    A period that is given outdoes one that is assumed.
    """
    clocks = [values[each.name] for each in names if each.quantity is Quantity.TIME]
    apart = any(not np.array_equal(each, clocks[0], equal_nan=True) for each in clocks)
    if apart and 2 * len(clocks) == len(names) and known.period_s is None:
        why = "each channel has times of its own, and they differ: bring all to one time first"
        found.ask("--period", _PERIOD, why)
        return None
    others = Understanding() if len(clocks) > 1 else found
    names = [each for each in names if not _is_set_aside(each, values[each.name], known, others)]
    for quantity in (Quantity.COUNTER, Quantity.TIME)[:: 1 if known.period_s else -1]:
        for each in (each for each in names if each.quantity is quantity):
            scale = _scale(each, values[each.name], known, found)
            if scale is not None:
                found.columns[TIME] = ColumnMap(each.name, scale)
                return scale * values[each.name]
    return _by_rows(names, values, known, found)


def _is_set_aside(each: ColumnName, values: Floats, known: Known, found: Understanding) -> bool:
    """Times that a given period outdoes, unless they count, and those that do not part the rows."""
    steps = np.diff(values[np.isfinite(values)])
    if each.quantity is not Quantity.TIME or not steps.size:
        return False
    if known.period_s is not None:
        return bool(each.unit) or float(np.median(steps)) != 1.0 or bool(np.any(steps % 1.0))
    same, why = float(np.mean(steps == 0.0)), ""
    if same > _MOST_REPEATED:
        why = f"{each.name!r} repeats {100.0 * same:.0f} % of its times: it has too few digits"
    elif float(np.mean(steps < 0.0)) > _MOST_BACKWARDS:
        why = f"{each.name!r} runs backwards: sort the rows by it"
    if why:
        found.ask("--period", _PERIOD, why)
    return bool(why)


def _scale(each: ColumnName, values: Floats, known: Known, found: Understanding) -> float | None:
    """Seconds per count of a column that counts up; None if it is no clock."""
    usual = usual_step(values)
    if not usual:
        found.say(TIME, f"{each.name!r} never increases, so it is no clock")
        return None
    if each.quantity is Quantity.COUNTER or known.period_s is not None:
        if known.period_s is not None:
            found.say(TIME, f"{each.name!r} counts samples of {known.period_s:g} s, as given")
            return known.period_s
        if each.name != "CYCLE":
            return None
        cycles = "position-control cycles of 2 ms, as Industrial Edge has them by default"
        found.say(TIME, f"{each.name!r} counts {cycles}", assumed=True)
        return EDGE_PERIOD_S
    unit, why = each.unit, each.why
    if each.si_unit != "s":
        is_of_windows = _HUNDRED_NS[0] < float(np.nanmedian(values)) < _HUNDRED_NS[1]
        units = ("100 ns",) if is_of_windows else _TIME_UNITS
        rates = {unit: 1.0 / (SI[unit][0] * usual) for unit in units}
        low, high = _RATES_HZ[0], _RATES_HZ[1] * (1.0 + 1e-9)
        fitting = [unit for unit, rate_hz in rates.items() if low <= rate_hz <= high]
        unit, why = (*fitting, "s")[0], "assumed: no unit gives a usual rate"
        if len(fitting) == 1:
            why = "the only unit that gives a rate between 10 Hz and 20 kHz"
        elif fitting:
            why = "assumed: finer units would also give a usual rate"
    scale: float = SI[unit][0]
    clock = clock_of([scale * values]).as_text()
    assumed = why.startswith("assumed")
    found.say(TIME, f"{each.name!r} in {unit} ({why}): {clock}", assumed=assumed)
    return scale


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
        if not found.questions:
            found.ask("--period", _PERIOD, "no column holds the time")
        return None
    found.columns[TIME] = ColumnMap(ROW_NUMBER, period_s)
    words = f"a row is {period_s:.4g} s ({why})"
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
