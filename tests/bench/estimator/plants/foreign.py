"""Cases of the estimator's bench on a second plant that shares no code with the library."""

import tomllib
from collections.abc import Iterator
from functools import cache
from typing import Any

from edge_service.estimate.commissioning.identification import commissioned
from edge_service.messages.samples import TABLE_POSITION, TABLE_SPEED, TIME, SampleFrame
from edge_service.models.machine import Machine

from .... import foreign_plant as plant
from ..axis import FRAME_ROWS, downsampled
from ..scores import Recorded
from .own import Part, judged

EVENT_S = 30.0
ROW = "foreign plant: "


@cache
def nominal_machine() -> Machine:
    return Machine.model_validate(tomllib.loads(plant.nominal_machine_toml(plant.Machine())))


def recorded(case: Any, one_encoder: bool = False, clock_s: float = 0.0) -> Recorded:
    """Simulate and downsample; `clock_s` is what the recorder's clock shows at the start."""
    recording = plant.simulate(case)
    columns = dict(recording.columns)
    time_s = columns.pop(TIME) + clock_s
    if one_encoder:
        del columns[TABLE_POSITION], columns[TABLE_SPEED]
    whole, starts = SampleFrame(time_s, columns), range(0, len(time_s), FRAME_ROWS)
    frames = (whole.part(slice(first, first + FRAME_ROWS)) for first in starts)
    truth = recording.truth
    blocks = downsampled(frames, nominal_machine())
    return Recorded(blocks, truth["time_s"] + clock_s, truth["preload_percent"])


@cache
def commissioned_machine(axis_seed: int, one_encoder: bool = False) -> Machine:
    """From its rich motion on the healthy, cold axis."""
    case = plant.commissioning_case(axis_seed=axis_seed)
    blocks = recorded(case, one_encoder).blocks
    return commissioned([blocks], nominal_machine())


def scenarios(quick: bool) -> dict[str, dict[str, Any]]:
    """Arguments of `axis_case` by the row's name; a `loss` is judged, the rest simulated."""
    fresh = plant.Machine().preload_percent
    warm_s, hot_s = (100.0, 300.0) if quick else (900.0, 600.0)
    every: dict[str, dict[str, Any]] = {
        "healthy": {},
        "ramp to 0": {"preload": plant.Ramp(fresh, 0.0, 0.0, 60.0)},
        "ramp 75 to 25 %": {"preload": plant.Ramp(0.75 * fresh, 0.25 * fresh, 0.0, 60.0)},
        "full drop": {"preload": plant.Steps(fresh, ((EVENT_S, 0.0),)), "loss": 0.5 * fresh},
        "one-point step": {
            "preload": plant.Steps(fresh, ((EVENT_S, fresh - 1.0),)),
            "loss": fresh - 0.5,
        },
        "constant 2 %": {"preload": 2.0},
        "constant 0 %": {"preload": 0.0},
        "warm-up": {"duration_s": warm_s, "events": (plant.Warmup(time_constant_s=hot_s),)},
        "payload +10 kg": {"events": (plant.Payload(((EVENT_S, 10.0),)),)},
        "relubrication": {"events": (plant.Relubrication(EVENT_S, 0.25, 0.25),)},
        "process force 30 % of the time": {"events": (plant.ProcessForce(400.0, duty=0.3),)},
        "process force 40 % of the time": {"events": (plant.ProcessForce(400.0, duty=0.4),)},
    }
    if quick:
        return {name: every[name] for name in ("full drop", "warm-up", "relubrication")}
    return every


def foreign(axis_seed: int, quick: bool) -> Iterator[Part]:
    machine, nominal = commissioned_machine(axis_seed), nominal_machine()
    for name, given in scenarios(quick).items():
        kwargs = dict(given)
        level = kwargs.pop("loss", None)
        case = plant.axis_case(seed=100 + axis_seed, axis_seed=axis_seed, **kwargs)
        yield judged(
            ROW + name,
            machine,
            nominal,
            recorded(case),
            loss=None if level is None else (EVENT_S, level),
            event_s=EVENT_S if "events" in kwargs and name != "warm-up" else 10.0,
            every=1 if name != "warm-up" else 2,
        )


def foreign_one_encoder(axis_seed: int, quick: bool) -> Iterator[Part]:
    given = scenarios(quick)["warm-up"]
    case = plant.axis_case(seed=200 + axis_seed, axis_seed=axis_seed, **given)
    yield judged(
        ROW + "warm-up, one encoder",
        commissioned_machine(axis_seed, one_encoder=True),
        nominal_machine(),
        recorded(case, one_encoder=True),
        event_s=10.0,
        every=2,
    )
