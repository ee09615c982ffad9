"""Recordings of real machines that lie beside the checkout, as traces; none is copied into it.

Cranfield (CORD 5097649): a linear actuator at 25 Hz, its current unsigned. Screws at 100 Hz.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from edge_service.messages.samples import Floats

DATA = Path(__file__).parents[3] / "shared" / "data"
SEQUENCES = 10
"""Moves there and back that make one recording."""
_TOML = """
[axis]
name = "{}"
lead_m = {}

[model]
inertia_kg_m2 = {{ value = {}, tolerance = 0.3 }}
viscous_nm_s_per_rad = {{ value = {}, tolerance = 1.0 }}
preload_drag_nm = {{ value = {}, tolerance = {} }}
"""
ACTUATOR_TOML = _TOML.format("A", 0.005, 3e-5, 1e-5, 0.05, 0.5)
SCREW_TOML = _TOML.format("LinA", 0.006, 5.2e-4, 1e-3, 0.02, 1.0)
NM_PER_A = 0.0429 * 624.0 / 35.0


def written(path: Path, columns: Mapping[str, Floats]) -> str:
    """Write columns, each (n,), as a trace; returns its path."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    return str(path)


def moves(path: Path) -> dict[int, list[Floats]]:
    """Sequences by their load: time s, setpoint mm, position error mm, current A, (n, 4) each."""
    names = ("load", "time", "set_point", "position_error", "current")
    rows = np.genfromtxt(path, delimiter=",", names=True)
    found = {}
    for load in np.unique(rows["load"]):
        table = np.column_stack([rows[rows["load"] == load][name] for name in names[1:]])
        found[int(load)] = np.split(table, np.flatnonzero(np.diff(table[:, 0]) < 0.0) + 1)
    return found


def one_actuator(sequences: Iterable[Floats]) -> dict[str, Floats]:
    """Sequences in one; the current has the sign of the motion that is asked for."""
    parts, clock_s = [], 0.0
    for each in sequences:
        position = 1e-3 * (each[:, 1] - each[:, 2])
        torque = 0.1 * each[:, 3] * np.sign(np.gradient(each[:, 1]))
        parts.append(np.column_stack((each[:, 0] + clock_s, torque, position)))
        clock_s = float(parts[-1][-1, 0]) + 1.0
    names = ("time_s", "torque_command_nm", "table_position_m")
    return dict(zip(names, np.vstack(parts).T, strict=True))


def recordings(folder: Path, condition: str, load: str) -> list[str]:
    every = moves(DATA / "cranfield" / f"{condition}.csv")[int(load)]
    return [
        written(folder / f"{condition}{k}.csv", one_actuator(every[k : k + SEQUENCES]))
        for k in range(0, len(every), SEQUENCES)
    ]


def screw_actuator(path: Path, name: str) -> str:
    table = np.loadtxt(DATA / "screw_actuators" / f"{name}.txt")
    columns = {
        "time_s": 1e-3 * table[:, 0],
        "torque_command_nm": NM_PER_A * 1e-3 * table[:, 5],
        "table_position_m": 1e-3 * table[:, 3],
        "position_setpoint_m": 1e-3 * table[:, 1],
    }
    return written(path, columns)
