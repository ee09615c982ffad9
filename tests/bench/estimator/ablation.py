"""Worth of each state, hypothesis and constant of the estimator on plants it was not set on.

Every recording is followed once as the estimator is, and once for each part taken away or changed.
"""

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from edge_service.config import DEFAULT_CONFIG, EdgeConfig, load_config, load_machine
from edge_service.estimate.mixture.estimator import FusedPreloadEstimator
from edge_service.estimate.mixture.model import MixtureSettings
from edge_service.estimate.mixture.state import LOAD, LOOSENING, LOSS, LUBRICATION, TOTAL_LOSS
from edge_service.models.machine import Machine
from edge_service.nodes.wiring.stages import make_downsampler
from edge_service.offline.commission import commission_to_file
from edge_service.offline.recordings import open_recording

from ... import foreign_plant
from ..life.bench import KeptEstimator, drawn_life
from ..life.plants import plant_of
from ..life.scores import life_score
from ..pool import in_processes
from ..table import Section
from .plants.foreign import commissioned_machine, recorded, scenarios
from .plants.second_plant import has_second_plant, make_recordings
from .scores import Recorded, Score, follow, pooled, score

WHOLE = "the estimator as it is"
_USUAL = MixtureSettings()


def _drifting(factor: float) -> MixtureSettings:
    """Settings of an axis whose frictions move farther, alike and apart."""
    together, apart = factor * _USUAL.together, factor * _USUAL.apart
    return MixtureSettings(together=together, apart=apart)


VARIANTS: Mapping[str, MixtureSettings] = {
    WHOLE: _USUAL,
    "no REVERSAL": MixtureSettings(reversal=0.0),
    "no TABLE_MASS beyond the data sheet's": MixtureSettings(twist=0.0),
    "no WEAR_RATE": MixtureSettings(wear_rate=0.0, rate_walk=0.0),
    "no WEARING": MixtureSettings(wear_walk=_USUAL.preload_walk),
    "no LOSS": MixtureSettings(without=(LOSS,)),
    "no TOTAL_LOSS": MixtureSettings(without=(TOTAL_LOSS,)),
    "no LUBRICATION": MixtureSettings(without=(LUBRICATION,)),
    "no LOAD": MixtureSettings(without=(LOAD,)),
    "no LOOSENING": MixtureSettings(without=(LOOSENING,)),
    "no process forces": MixtureSettings(force_share=0.0, rapid_share=0.0),
    "one beginning": MixtureSettings(half=0.0, none=0.0, loaded=0.0),
    "no LOOSENESS at the start": MixtureSettings(looseness=0.0),
    "three times the LOOSENESS at the start": MixtureSettings(looseness=3.0 * _USUAL.looseness),
    "nothing wanders": MixtureSettings(wander=0.0),
    "growth of the screw is smooth": MixtureSettings(uneven_share=0.0),
    "twice as uneven a growth": MixtureSettings(uneven_share=2.0 * _USUAL.uneven_share),
    "no axial friction": MixtureSettings(axial=0.0),
    "a phase may say anything": MixtureSettings(most_nats=1e3),
    "all evidence counts": MixtureSettings(evidence=1.0),
    "half the drift of friction": _drifting(0.5),
    "twice the drift of friction": _drifting(2.0),
    "half the memory of friction": MixtureSettings(friction_s=0.5 * _USUAL.friction_s),
    "twice the memory of friction": MixtureSettings(friction_s=2.0 * _USUAL.friction_s),
    "no force lasts": MixtureSettings(force_stay=0.0),
    "a fifth of the process forces": MixtureSettings(force=0.2 * _USUAL.force),
    "steps ten times as likely": MixtureSettings(hazard=10.0 * _USUAL.hazard),
    "steps a tenth as likely": MixtureSettings(hazard=0.1 * _USUAL.hazard),
}
FOREIGN, SECOND, LIVES = "foreign", "second", "lives"
FOREIGN_AXES = (3, 4, 5)
LIFE_AXES, LIFE_SHAPES = (4, 5), ("healthy", "linear", "sudden step")
EVERY = 5
_ONE_ENCODER = "one_encoder"
_FIGURES: tuple[tuple[str, Callable[[Score], float]], ...] = (
    ("MAE", lambda of: of.mae),
    ("wrong", lambda of: of.wrong),
    ("score", lambda of: of.interval_score),
)


@dataclass(frozen=True, slots=True)
class Ablated:
    """Score of one variant that followed one recording of a plant."""

    plant: str
    variant: str
    score: Score


def run_ablation(
    second_plant: Path,
    seeds: Sequence[int],
    quick: bool,
    processes: int,
    say: Callable[[str], None],
) -> list[Ablated]:
    """All variants over the foreign plant and, where its commands are, the second plant.

    Args:
        seeds: of the second plant.
    """
    found: dict[int, list[Ablated]] = {}
    with tempfile.TemporaryDirectory(prefix="ablation-") as home:
        axes = FOREIGN_AXES[: 1 if quick else None]
        jobs = [partial(on_foreign_axis, axis, quick) for axis in axes]
        lives = list(product(LIFE_AXES, LIFE_SHAPES))[: 1 if quick else None]
        jobs += [partial(on_life, axis, shape, quick) for axis, shape in lives]
        for seed in seeds if has_second_plant(second_plant) else ():
            out = Path(home) / str(seed)
            say(f"ablation: making recordings of the second plant, seed {seed}")
            make_recordings(second_plant, out, seed, quick, processes, say)
            for folder in sorted(out.glob("machine-*")):
                jobs += [partial(on_second_axis, folder, sheet) for sheet in (False, True)]
        for number, result in in_processes(jobs, processes):
            found[number] = result
            say(f"ablation: {len(found)} of {len(jobs)} axes, {len(VARIANTS)} variants each")
    return [each for number in range(len(jobs)) for each in found[number]]


def on_foreign_axis(axis_seed: int, quick: bool) -> list[Ablated]:
    """All variants over the scenarios of one axis."""
    plant, machine = foreign_plant, commissioned_machine(axis_seed)
    every: list[Ablated] = []
    for given in scenarios(plant, quick).values():
        kwargs = {name: value for name, value in given.items() if name != "loss"}
        case = plant.axis_case(seed=100 + axis_seed, axis_seed=axis_seed, **kwargs)
        every += _variants(FOREIGN, machine, recorded(case))
    return every


def on_life(axis_seed: int, shape: str, quick: bool) -> list[Ablated]:
    """All variants over a life on the foreign plant, the state kept between its sessions."""
    axis = plant_of(FOREIGN, axis_seed)
    life = drawn_life(axis, shape, axis_seed, quick)
    recordings = [axis.recorded(session) for session in life.sessions]
    machine = commissioned_machine(axis_seed)
    every: list[Ablated] = []
    for name, settings in VARIANTS.items():
        kept = KeptEstimator(partial(FusedPreloadEstimator, machine, settings))
        tracks = [kept.follow(recorded) for recorded in recordings]
        every.append(Ablated(LIVES, name, life_score(life, tracks).rows))
    return every


def on_second_axis(folder: Path, sheet: bool) -> list[Ablated]:
    """All variants over the recordings of one machine, commissioned as a stranger would."""
    config = load_config(DEFAULT_CONFIG)
    every: list[Ablated] = []
    machines: dict[bool, Machine] = {}
    for one_encoder in (False, True):
        nominal = folder / ("nominal_sheet.toml" if sheet else "nominal.toml")
        healthy = folder / ("commissioning_one_encoder" if one_encoder else "commissioning")
        out = folder / f"taught-{sheet:d}-{one_encoder:d}.toml"
        commission_to_file(nominal, sorted(healthy.glob("*.csv")), out, config, assume_fresh=True)
        machines[one_encoder] = load_machine(out)
    for trace in sorted((folder / "traces").glob("*.csv")):
        machine = machines[trace.stem == _ONE_ENCODER]
        truth_file = folder.parent / "hidden" / f"{folder.name}-{trace.stem}.npz"
        every += _variants(SECOND, machine, read_recorded(trace, truth_file, machine, config))
    return every


def read_recorded(trace: Path, truth_file: Path, machine: Machine, config: EdgeConfig) -> Recorded:
    """A recording of the second plant with its truth."""
    downsampler = make_downsampler(config.downsample, machine)
    with open_recording(machine, trace) as frames:
        blocks = [block for frame in frames for block in downsampler.push(frame)]
    with np.load(truth_file) as known:
        truth = known["truth"]
    return Recorded(blocks, truth[:, 0], truth[:, 1])


def _variants(plant: str, machine: Machine, case: Recorded) -> Iterator[Ablated]:
    for name, settings in VARIANTS.items():
        estimator = FusedPreloadEstimator(machine, settings)
        yield Ablated(plant, name, score(follow(estimator, case, EVERY)))


def ablation_section(parts: Sequence[Ablated]) -> Section:
    """One row for each variant, its figures on each plant."""
    plants = list(dict.fromkeys(part.plant for part in parts))
    rows = []
    for variant in dict.fromkeys(part.variant for part in parts):
        row: list[object] = []
        for plant in plants:
            mine = [p.score for p in parts if (p.plant, p.variant) == (plant, variant)]
            row += [figure(pooled(mine)) for _, figure in _FIGURES]
        rows.append((variant, tuple(row)))
    heads = tuple(f"{name}, {plant}" for plant in plants for name, _ in _FIGURES)
    whole = [part.plant for part in parts if part.variant == parts[0].variant]
    each = ", ".join(f"{plant} {whole.count(plant)}" for plant in plants)
    return Section(
        name="ablation",
        title="one part taken away or changed",
        heads=heads,
        rows=tuple(rows),
        notes=(f"recordings: {each}; MAE in points, wrong: share confidently wrong",),
    )
