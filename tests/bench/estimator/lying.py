"""Fresh axes of which one channel lies: zeros, old and held values, marks, bits, wraps, grids."""

from collections.abc import Iterable, Iterator

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages import samples
from edge_service.messages.samples import TIME, Floats, SampleFrame

from ... import foreign_plant
from ...cases.case_file import Edit
from ...cases.edits import edited
from .axis import RATE_HZ, OwnAxis, downsampled
from .losses import LossPart
from .plants.foreign import commissioned_machine
from .scores import Recorded, follow, score

CHANNELS = (samples.TORQUE, samples.ANGLE, samples.TABLE_POSITION)
_TOLD = 0.01  # share of wrong numbers from which on a kind has a row of its own


def lies(name: str, values: Floats, duration_s: float) -> dict[str, Edit]:
    """Kind -> fault of the channel `name` with `values` (n,)."""
    span, later_s = float(np.ptp(values)), (0.5 * duration_s, duration_s)
    kinds = {f"{100 * p:g} % are 0": Edit(value={name: 0.0}, share=p) for p in (0.002, 0.01, 0.03)}
    for rows, share in ((5, 0.03), (20, 0.01), (20, 0.03), (3, 1.0), (10, 1.0)):
        kinds[f"{100 * share:g} % are {rows} ms old"] = Edit(old_rows={name: rows}, share=share)
    kinds |= {f"new every {k} ms": Edit(held_rows={name: k}) for k in (2, 3, 4, 5)}
    kinds |= {f"{mark:g}": Edit(value={name: mark}, share=0.003) for mark in (-32768.0, 1e6)}
    kinds |= {f"bit {k}": Edit(shift={name: 0.5**k * span}, share=0.005) for k in (2, 5, 12)}
    kinds |= {f"of {k} bits": Edit(steps={name: 0.5**k * span}) for k in (12, 15, 18)}
    kinds["wraps"] = Edit(wrap={name: 0.7 * span})
    kinds["11 % more, later"] = Edit(scale={name: 1.11}, between_s=later_s)
    for p, when, at_s in ((0.03, "", None), (0.05, ", later", later_s)):
        kinds[f"shifted by {100 * p:g} %{when}"] = Edit(shift={name: p * span}, between_s=at_s)
    return kinds


def spoiled(frames: Iterable[SampleFrame], edit: Edit, seed: int = 1) -> SampleFrame:
    """All frames as one, with the fault."""
    parts = [{TIME: frame.time_s, **frame.channels} for frame in frames]
    columns = edited({n: np.concatenate([part[n] for part in parts]) for n in parts[0]}, edit, seed)
    return SampleFrame(columns.pop(TIME), columns)


def lied(plant: str, axis_seed: int, duration_s: float) -> Iterator[LossPart]:
    """Tell each lie to a fresh axis of the plant `own` or `foreign`, commissioned on the truth."""
    if plant == "own":
        axis, count = OwnAxis(axis_seed), round(duration_s * RATE_HZ)
        machine, fresh = axis.commissioned(), axis.fresh_percent
        truth = spoiled(axis.frames("production", np.full(count, fresh), axis_seed + 100), Edit())
    else:
        machine, fresh = commissioned_machine(axis_seed), foreign_plant.Machine().preload_percent
        case = foreign_plant.axis_case(
            fresh, duration_s=duration_s, axis_seed=axis_seed, seed=axis_seed + 100
        )
        columns = dict(foreign_plant.simulate(case).columns)
        truth = SampleFrame(columns.pop(TIME), columns)
    assert machine.commissioned is not None  # `commission` writes how long a channel holds, too
    learned = machine.commissioned.model_copy(update={"hold_s": (0.0, 0.0, 0.0)})
    machine = machine.model_copy(update={"commissioned": learned})
    for channel in CHANNELS:
        for kind, edit in lies(channel, truth.channels[channel], duration_s).items():
            frame = spoiled([truth], edit, axis_seed)
            blocks, percent = downsampled([frame], machine), np.full(len(frame), fresh)
            recorded = Recorded(blocks, frame.time_s, percent)
            found = score(follow(MixturePreloadEstimator(machine), recorded))
            told = f"{channel}: {kind if found.wrong > _TOLD else 'other lies'}"
            yield LossPart(plant, told, axis_seed, found, 0.0)
