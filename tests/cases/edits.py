"""Faults of a recorder, put into the columns of a sound recording."""

import numpy as np

from edge_service.messages.samples import Floats

from .case_file import Edit

Columns = dict[str, Floats]
TIME = "time_s"


def edited(columns: Columns, edit: Edit, seed: int = 1) -> Columns:
    """Columns, each (n,), with the fault; the same seed spoils the same rows."""
    columns = {name: np.array(values) for name, values in columns.items()}
    rng = np.random.default_rng(seed)
    _in_place(columns, edit, rng)
    for name, step in edit.steps.items():
        columns[name] = step * np.round(columns[name] / step)
    _clock(columns[TIME], edit)
    kept = {name: x for name, x in _rows(columns, edit, rng).items() if name not in edit.drop}
    return {edit.rename.get(name, name): values for name, values in kept.items()}


def _in_place(columns: Columns, edit: Edit, rng: np.random.Generator) -> None:
    low_s, high_s = edit.between_s or (-np.inf, np.inf)
    there = (columns[TIME] >= low_s) & (columns[TIME] < high_s)
    for name, factor in edit.scale.items():
        columns[name][there] *= factor
    for name, added in edit.shift.items():
        columns[name][there & (rng.random(len(there)) < edit.share)] += added
    if edit.drag_nm:
        way = np.tanh(columns["motor_speed_rad_s"] / 0.1)
        columns["torque_command_nm"][there] += edit.drag_nm * way[there]
    for name in edit.unsigned:
        columns[name][there] = np.abs(columns[name][there])
    for name in edit.stuck:
        columns[name][there] = columns[name][there][0]
    for name in edit.missing:
        columns[name][there & (rng.random(len(there)) < edit.share)] = np.nan
    for name, value in edit.value.items():
        columns[name][there & (rng.random(len(there)) < edit.share)] = value
    for name, rows in edit.old_rows.items():
        late = np.flatnonzero(there & (rng.random(len(there)) < edit.share))
        columns[name][late] = columns[name][np.maximum(late - rows, 0)]
    for name, rows in edit.held_rows.items():
        columns[name] = np.repeat(columns[name][::rows], rows)[: len(there)]
    for name, turn in edit.wrap.items():
        columns[name] %= turn
    order = np.arange(len(there))
    for name in columns if edit.interpolated_rows > 1 else ():
        kept = order[:: edit.interpolated_rows]
        columns[name] = np.interp(order, kept, columns[name][kept])
    for name, deviation in edit.noise.items():
        columns[name][there] = deviation * rng.standard_normal(there.sum())


def _clock(time_s: Floats, edit: Edit) -> None:
    half = len(time_s) // 2
    time_s[half:] += edit.clock_jump_s
    if edit.clock_restart:
        time_s[half:] -= time_s[half]


def _rows(columns: Columns, edit: Edit, rng: np.random.Generator) -> Columns:
    n = len(columns[TIME])
    times = np.where(rng.random(n) < edit.missing_rows, 0, 1 + (rng.random(n) < edit.repeated_rows))
    rows = np.repeat(np.arange(n), times)[:: -1 if edit.newest_first else 1]
    return {name: values[rows] for name, values in columns.items()}
