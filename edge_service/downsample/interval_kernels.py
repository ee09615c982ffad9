"""Arithmetic over the rows of one interval as machine code: each loop is one call."""

from typing import Any

import numpy as np

from ..checks.live.repeats import LEAST_ROWS
from ..messages.features import Fault
from ..messages.row_faults import FORCE, TEMP, THETA, T, U, X
from ..messages.samples import Floats, Integers
from ..models.compiled import compiled
from ..models.steady_limits import LONGEST_HOLD_S

_HOLE = int(Fault.HOLE)
_LEAST_SCATTER, _MOST_SCATTER = 1e-3, 0.3
"""Scatter of the time stamps, in periods, between which they are doubted: more comes in bunches."""
_SLOWEST, _COUNTED, _SETTLED, _MOST_STEPS, _LEAST_MOVING = 0.02, 16, 100, 6, 200
AT_S, PERIOD_S, ROWS, SCATTER_S2, XX, XY, YY, MOVING = range(8)
ANGLE_2, ANGLE_1, LATE_2_S, LATE_1_S, EVEN, CLOCK_STATES = range(8, 14)


@compiled
def even_out(rows: Floats, clock: Floats) -> None:
    """Replace time stamps that scatter by the even clock behind them, if the angle follows that.

    An alpha-beta filter follows the stamps. Where the angle bends as they scatter, the samples were
    taken at those times, which they keep.

    Args:
        rows: (n, 8), rising in time.
        clock: (CLOCK_STATES,), zeros but for the period before the first row, s.
    """
    for row in rows:
        time_s, last_s = row[T], clock[AT_S]
        steps = np.round((time_s - last_s) / clock[PERIOD_S])
        steps = max(steps, 1.0) if clock[ROWS] > _COUNTED else 1.0
        late_s = time_s - last_s - steps * clock[PERIOD_S]
        clock[ROWS] += 1.0
        if clock[ROWS] == 1.0 or steps > _MOST_STEPS:
            clock[ROWS], clock[AT_S] = 1.0, time_s
            continue
        gain = max(4.0 / (clock[ROWS] + 16.0), _SLOWEST)
        clock[AT_S] = time_s - (1.0 - gain) * late_s
        clock[PERIOD_S] += 0.5 * gain * gain * late_s / steps
        clock[SCATTER_S2] += gain * (late_s * late_s - clock[SCATTER_S2])
        bend = row[THETA] - 2.0 * clock[ANGLE_1] + clock[ANGLE_2]
        stamped = (late_s - 2.0 * clock[LATE_1_S] + clock[LATE_2_S]) / clock[PERIOD_S]
        stamped *= 0.5 * (row[THETA] - clock[ANGLE_2])
        settled = clock[ROWS] > _SETTLED
        if settled and steps == 1.0 and not np.isnan(bend):
            clock[XX] += stamped * stamped
            clock[XY] += stamped * bend
            clock[YY] += bend * bend
            clock[MOVING] += row[THETA] != clock[ANGLE_1]
        clock[ANGLE_2], clock[LATE_2_S] = clock[ANGLE_1], clock[LATE_1_S]
        clock[ANGLE_1], clock[LATE_1_S] = row[THETA] if steps == 1.0 else np.nan, late_s
        scatter = np.sqrt(clock[SCATTER_S2]) / clock[PERIOD_S]
        error = np.sqrt(clock[XX] * clock[YY] / max(clock[MOVING], 1.0))
        is_even = 0.5 * clock[XX] - clock[XY] > 3.0 * error and clock[MOVING] > _LEAST_MOVING
        is_even &= settled and _LEAST_SCATTER < scatter < _MOST_SCATTER
        if is_even or (clock[EVEN] and time_s <= last_s):
            row[T] = clock[AT_S]
        clock[EVEN] = is_even


@compiled
def rises(rows: Floats, newest_s: float, *columns: int) -> bool:
    """Return whether rows (n, 8) rise in time from the newest on, with values in some columns."""
    for row in rows:
        if not row[T] > newest_s:
            return False
        for column in columns:
            if np.isnan(row[column]):
                return False
        newest_s = row[T]
    return True


@compiled
def mark_holes(rows: Floats, fault: Integers, start: int, period_s: float, most: int) -> int:
    """First row from `start` on that comes after a gap; the number of rows if there is none.

    Args:
        rows: (n, 8).
        fault: (n,), which gets a bit at the end of each hole before it.
        most: periods without a row that are bridged.
    """
    for row in range(start, len(rows)):
        steps = (rows[row, T] - rows[row - 1, T]) / period_s
        if steps > most + 0.5:
            return row
        if steps > 1.5:
            fault[row] |= _HOLE
    return len(rows)


@compiled
def ends(rows: Floats, first: int, interval_s: float, slack: float) -> Integers:
    """Rows behind `first` that begin another interval of the grid, (k,)."""
    found, count, grid = np.empty(len(rows) - first, dtype=np.int64), 0, np.nan
    for row in range(first, len(rows)):
        interval = np.floor(rows[row, T] / interval_s + slack)
        if row > first and interval != grid:
            found[count] = row
            count += 1
        grid = interval
    return found[:count]


@compiled
def of_interval(
    segment: Floats,
    first: int,
    end: int,
    reach: int,
    before: tuple[float, float, float],
    limits: Floats,
) -> tuple[Floats, Floats, Floats]:
    """Numbers of an interval, what else its rows show, and its phases.

    Args:
        segment: (n, 8) rows; those of the interval are [first, end).
        reach: half width of differences, rows.
        before: direction before the interval, beginning of that motion, s, and standstill, rad/s.
        limits: as of `phases`.

    Returns:
        The numbers of a FeatureBlock in its order, without counts of samples and faults, (24,);
        direction and beginning of the motion at the end, fastest step, direction of the phases,
        greatest angle and torque, way, missing torques, time for which torque and angle repeat a
        value, and those rows of the angle, (12,); and (3, 6).
    """
    inside, rows = segment[first : end + 1], end - first
    time_s, theta = inside[:, T], inside[:, THETA]
    direction = directions(segment, first, end, reach, before[2])
    since_s, values, row, shown = np.empty(rows), np.empty(rows), np.zeros(24), np.zeros(12)
    known, began_s = before[0], time_s[0]
    if direction[0] == known and np.isfinite(before[1]):
        began_s = before[1]
    row[12], row[13], low, high = np.inf, -np.inf, theta[rows], theta[rows]
    for k in range(rows):
        here, later, values[k] = inside[k], inside[k + 1], _between(inside, k)
        step_s = later[T] - here[T]
        speed = (later[THETA] - here[THETA]) / step_s
        row[9] += (later[THETA] + here[THETA]) * step_s
        row[12], row[13] = min(row[12], speed), max(row[13], speed)
        row[21] += (later[X] + here[X]) * step_s
        low, high = min(low, here[THETA]), max(high, here[THETA])
        if k and direction[k] != direction[k - 1]:
            began_s = here[T]
        since_s[k] = np.inf
        if direction[k] != 0.0:
            row[16], since_s[k] = row[16] + step_s, began_s
            row[17], known = row[17] + (known not in (0.0, direction[k])), direction[k]
    row[0], row[1] = time_s[-1], time_s[-1] - time_s[0]
    row[2], row[3] = lever(values, time_s)
    row[4], row[5], row[6] = np.min(values), np.max(values), np.std(values)
    row[7], row[8], row[9] = theta[0], theta[-1], row[9] / (2.0 * row[1])
    row[14], row[15] = lever(direction, time_s)
    row[16] /= row[1]
    if direction[0] == before[0]:
        row[18] = max(time_s[0] - before[1], 0.0)
    row[19], row[20], row[21] = inside[0, X], inside[rows, X], row[21] / (2.0 * row[1])
    row[22], row[23] = _mean_known(inside, TEMP), _mean_known(inside, FORCE)
    shown[3], parts = phases(segment, first, end, reach, since_s, limits)
    shown[0], shown[1], shown[4], shown[6] = known, since_s[-1], np.max(np.abs(theta)), high - low
    for k in range(max(first - 1, 0), min(end + 1, len(segment) - 1)):
        here, later = segment[k], segment[k + 1]
        shown[2] = max(shown[2], abs(later[THETA] - here[THETA]) / (later[T] - here[T]))
    for each in inside[:, U]:
        shown[7] += np.isnan(each)
        shown[5] = max(shown[5], 0.0 if np.isnan(each) else abs(each))
    for at, place in ((10, first), (11, end)):
        here, later = segment[max(place - 1, 0)], segment[min(place + 1, len(segment) - 1)]
        row[at] = (later[THETA] - here[THETA]) / (later[T] - here[T])
    shown[8] = longest_run(inside[:, U], time_s)[0]
    shown[9], shown[10], shown[11] = longest_run(theta, time_s)
    return row, shown, parts


@compiled
def lever(values: Floats, edges_s: Floats) -> tuple[float, float]:
    """Mean and lever of a held quantity.

    Args:
        values: (n,), each held from its edge to the next.
        edges_s: (n + 1,), s.

    Returns:
        (1/T) int q dt and (1/T^2) int (T - s) q ds over the interval of length T.
    """
    last, mean, moment = len(edges_s) - 1, 0.0, 0.0
    for row in range(len(values)):
        before, after = edges_s[last] - edges_s[row], edges_s[last] - edges_s[row + 1]
        mean += values[row] * (before - after)
        moment += values[row] * (before * before - after * after)
    duration = edges_s[last] - edges_s[0]
    return mean / duration, moment / (2.0 * duration * duration)


@compiled
def directions(segment: Floats, first: int, end: int, reach: int, standstill: float) -> Floats:
    """Direction of motion of each row's interval, -1, 0 or 1, from a centred difference.

    Args:
        segment: (n, 8) rows; those of the interval are [first, end).
        reach: half width of the difference, rows.
        standstill: slower than this is 0, rad/s.
    """
    found = np.zeros(end - first)
    for row in range(first, end):
        before, behind = max(row - reach + 1, 0), min(row + reach, len(segment) - 1)
        way = segment[behind, THETA] - segment[before, THETA]
        speed = way / (segment[behind, T] - segment[before, T])
        if abs(speed) > standstill:
            found[row - first] = 1.0 if speed > 0.0 else -1.0
    return found


@compiled
def _mean_known(inside: Floats, column: int) -> float:
    """Mean of the rows that have a number; NaN if none does."""
    known, total = 0, 0.0
    for row in range(len(inside) - 1):
        if not np.isnan(inside[row, column]):
            known, total = known + 1, total + inside[row, column]
    return total / known if known else np.nan


@compiled
def longest_run(values: Floats, time_s: Floats) -> tuple[float, int, int]:
    """Longest time for which one value is repeated, s; its first row and the one behind it.

    Args:
        values: (n,).
        time_s: (n,).
    """
    longest_s, start, stop, begun, last = 0.0, 0, 1, 0, len(values) - 1
    for row in range(1, len(values)):
        ends = values[row] - values[row - 1] != 0.0
        if not ends and row < last:
            continue
        if row - begun >= LEAST_ROWS and time_s[row] - time_s[begun] > longest_s:
            longest_s, start, stop = time_s[row] - time_s[begun], begun, row
        begun = row
    return longest_s, start, max(stop, start + 1)


@compiled
def phases(
    segment: Floats, first: int, end: int, reach: int, since_s: Floats, limits: Floats
) -> Any:
    """Direction of the steady rows, and time and means of each phase.

    Acceleration is the divided second difference over `reach` rows on either side, which is the
    mean of the true one under a triangular window; torque, angle and table go through the same.

    Args:
        segment: (n, 8) rows; those of the interval are [first, end).
        since_s: (end - first,), when the motion of each row began, s; inf at standstill.
        limits: of steady motion: gate s, least speed rad/s, cruise rad/s^2, evenness.

    Returns:
        Direction, 0 if no row is steady, and (3, 6): accelerating, cruising, braking, each with
        its time s and the means of torque, acceleration, speed, angle and table.
    """
    begin, stop = max(first, reach), min(end, len(segment) - reach)
    sums = np.zeros((3, 6))
    count = max(stop - begin, 0)
    spans, steady = np.empty(count), np.zeros(count)
    forward, backward = 0, 0
    for row in range(begin, stop):
        before, behind = segment[row - reach], segment[row + reach]
        span = behind[T] - before[T]
        spans[row - begin] = span
        is_steady = _is_steady(before, segment[row], behind, since_s[row - first], limits)
        steady[row - begin] = is_steady
        forward, backward = forward + (is_steady > 0.0), backward + (is_steady < 0.0)
    if forward + backward == 0:
        return 0.0, sums
    direction = 1.0 if forward >= backward else -1.0
    for row in range(begin, stop):
        if steady[row - begin] == direction:
            _add_steady(sums, segment, row, reach, direction, limits[2])
    for part in range(3):
        if sums[part, 0] > 0.0:
            rows = sums[part, 0]
            sums[part, 1:] /= rows
            sums[part, 0] = rows * np.median(spans) / (2.0 * reach)
    return direction, sums


@compiled
def _is_steady(
    before: Floats, here: Floats, behind: Floats, since_s: float, limits: Floats
) -> float:
    """Direction of a row that moves steadily, -1 or 1; else 0."""
    span = behind[T] - before[T]
    speed = (behind[THETA] - before[THETA]) / span
    came = (here[THETA] - before[THETA]) / (here[T] - before[T])
    goes = (behind[THETA] - here[THETA]) / (behind[T] - here[T])
    uneven = abs(here[T] - before[T] - 0.5 * span) > limits[3] * 0.5 * span
    slow = not abs(speed) >= limits[1]
    if uneven or slow or not before[T] - since_s >= limits[0]:
        return 0.0
    sign = 1.0 if speed > 0.0 else -1.0
    return sign if came * sign > 0.0 and goes * sign > 0.0 else 0.0


@compiled
def _add_steady(
    sums: Floats, segment: Floats, row: int, reach: int, direction: float, cruise: float
) -> None:
    """Add a row to the sums of its phase; the first column counts."""
    before, here, behind = segment[row - reach], segment[row], segment[row + reach]
    span = behind[T] - before[T]
    came = (here[THETA] - before[THETA]) / (here[T] - before[T])
    goes = (behind[THETA] - here[THETA]) / (behind[T] - here[T])
    acceleration = (goes - came) / (0.5 * span)
    along = acceleration * direction
    part = 0 if along > cruise else (2 if along < -cruise else 1)
    speed = (behind[THETA] - before[THETA]) / span
    torque, angle, table = _windowed(segment, row, reach)
    for i, value in enumerate((1.0, torque, acceleration, speed, angle, table)):
        sums[part, i] += value


@compiled
def _between(rows: Floats, row: int) -> float:
    """Mean torque from a row to the next: held by the drive, or half-way between two points."""
    here, later = rows[row, U], rows[row + 1, U]
    if rows[row + 1, T] - rows[row, T] <= LONGEST_HOLD_S or np.isnan(later):
        return float(here)
    return 0.5 * float(here + later)


@compiled
def _windowed(segment: Floats, row: int, reach: int) -> tuple[float, float, float]:
    """Torque, angle and table under the triangular window of the second difference.

    The window rises from the row `reach` before to the row itself and falls to the row `reach`
    behind, whether or not they are evenly spaced.
    """
    begin, middle, end = segment[row - reach, T], segment[row, T], segment[row + reach, T]
    torque, angle, table, below = 0.0, 0.0, 0.0, 0.0
    for each in range(row - reach, row + reach):
        time_s = segment[each + 1, T]
        if time_s <= middle:
            after = (time_s - begin) ** 2 / ((end - begin) * (middle - begin))
        else:
            after = 1.0 - (end - time_s) ** 2 / ((end - begin) * (end - middle))
        torque += (after - below) * _between(segment, each)
        angle += (after - below) * 0.5 * (segment[each, THETA] + segment[each + 1, THETA])
        table += (after - below) * 0.5 * (segment[each, X] + segment[each + 1, X])
        below = after
    return torque, angle, table
