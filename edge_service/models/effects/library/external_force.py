"""A force on the table that nobody recorded, and those of processes and loading screws."""

from typing import NamedTuple

import numpy as np

from ....messages.samples import Floats
from ..contribution import Contribution, TableForce
from ..effect import Effect, Kind, Values, amount, shape


class Process(NamedTuple):
    """Cuts that follow one another, and the edges that pass in them."""

    every_s: float  # from the beginning of a cut to the next
    cut_s: float
    rise_s: float  # in which the force comes, and goes
    edges_hz: float
    ripple: float  # of the force, as a share of its mean


PROCESSES = {
    "milling": Process(10.0, 6.0, 0.1, 100.0, 1.0),
    "drilling": Process(6.0, 4.0, 0.5, 50.0, 0.05),
}
"""Two edges at 3000 and 1500 r/min. Assumed: a slot, whose chip is as thick as the sine of the
angle and whose force along the feed so 1 - cos(2 phi); the nearly even thrust of a twist drill."""


def process_force(name: str, mean_n: float, time_s: Floats) -> Floats:
    """Force of a process, or a steady one, at times (n,), N, for its mean in a cut (3.3.2).

    >>> process_force("drilling", 500.0, np.array([0.25, 2.0, 5.0])).round(1).tolist()
    [262.5, 475.0, 0.0]
    """
    if name == "steady":
        return np.full_like(time_s, mean_n)
    every_s, cut_s, rise_s, edges_hz, ripple = PROCESSES[name]
    since_s = np.fmod(time_s, every_s)
    share = np.clip(np.minimum(since_s, cut_s - since_s) / rise_s, 0.0, 1.0)
    return mean_n * share * (1.0 - ripple * np.cos(2.0 * np.pi * edges_hz * since_s))


def force_profile(text: str) -> Floats:
    """Times, s, and forces, N, of a CSV text with a header, (2, n). Raises ValueError."""
    rows: Floats = np.loadtxt(text.splitlines(), delimiter=",", skiprows=1, ndmin=2).T
    is_whole = len(rows) == 2 and np.isfinite(rows).all()
    if not is_whole or rows[0, -1] <= 0.0 or np.any(np.diff(rows[0]) <= 0.0):
        raise ValueError("expected columns time_s, force_n, with rising times above 0")
    return rows


def _contributions(values: Values) -> tuple[Contribution, ...]:
    start_s, end_s = values["start_s"], values["start_s"] + values["duration_s"]

    def pulse(time_s: Floats) -> Floats:
        return np.where((time_s >= start_s) & (time_s < end_s), values["force_n"], 0.0)

    return (TableForce(pulse),)


EFFECT = Effect(
    name="external_force",
    description="Something pushes the table for a while: a cut, a hose, a person.",
    source="thesis, Figure 5.14 (disturbance force): torque -R F(t), x - R theta by F(t) / K",
    kind=Kind.DISTURBANCE,
    parameters=(
        amount("force_n", "N", "Force, positive along the axis.", -1e5, 1e5, 200.0),
        shape("start_s", "s", "Time at which it begins.", 0.0, 1e7, 1.0),
        shape("duration_s", "s", "Duration.", 1e-3, 1e7, 5.0),
    ),
    contributions=_contributions,
    most_shapes=10,
)
