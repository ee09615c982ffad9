"""The mechanical fingerprint of an axis: every test that its recordings allow."""

import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from ..checks.sampling import TOO_SLOW, clock_of
from ..messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from ..models.machine import Machine
from ..regression.interval_estimate import undetermined
from ..regression.inverse_dynamics import identify_inverse_dynamics
from ..regression.prepared_run import PreparationSettings, PreparedRun, prepare
from .friction.cruises import FrictionPoint, friction_points, measure_equability, measure_signature
from .friction.curve import measure_friction, measure_friction_runs
from .response.two_mass_fit import measure_response, shakes
from .result import AxisFingerprint, Contents, Status, examined
from .transmission.nut_preload import measure_preload
from .transmission.reversal_error import measure_reversal_error
from .transmission.stiffness import StiffnessFit, measure_backlash, measure_stiffness, stretch_fit

CUTOFF_HZ = 100.0
"""Of the sampling rate, for slow recordings."""
_T = TypeVar("_T")


def fingerprint_axis(
    machine: Machine, recordings: Mapping[str, SampleFrame], fresh: AxisFingerprint | None = None
) -> AxisFingerprint:
    """Every section from all recordings together; their order and names mean nothing.

    Only the friction tests, where there are several, are also put in the order of their clocks,
    or of their names where they have no common clock: what changed from one to the next.

    Args:
        recordings: of one session, by name.
        fresh: of the same axis with the preload of the machine file, for the preload now.
    """
    names = sorted(recordings)
    frames = [recordings[name] for name in names]
    calm = [name for name in names if not shakes(recordings[name])]

    def prepared(among: Sequence[str], *required: str) -> dict[str, tuple[PreparedRun, ...]]:
        if not among:
            raise ValueError("every recording shakes the axis; this needs steady motion")
        able = [name for name in among if set(required) <= recordings[name].channels.keys()]
        if not able:
            raise ValueError(f"no recording has {' and '.join(required)}")
        needed = tuple(name for name in required if name != ANGLE)
        return {
            name: tuple(prepare(recordings[name], _settings(machine, [recordings[name]]), needed))
            for name in able
        }

    @functools.cache
    def with_torque() -> dict[str, tuple[PreparedRun, ...]]:
        return prepared(calm, TORQUE)

    @functools.cache
    def points() -> dict[str, tuple[FrictionPoint, ...]]:
        inertia = machine.model.inertia_kg_m2.value
        return {name: tuple(friction_points(each, inertia)) for name, each in with_torque().items()}

    @functools.cache
    def stretch() -> StiffnessFit:
        return stretch_fit(_all_of(prepared(names, ANGLE, TABLE_POSITION)), machine)

    def orders() -> Contents:
        return measure_signature(_all_of(with_torque()), machine.ball_pass_orders)

    tests: dict[str, tuple[str, Callable[[], Contents]]] = {
        "friction": ("friction", lambda: measure_friction(_all_of(points()))),
        "friction_runs": ("friction", lambda: measure_friction_runs(points())),
        "stiffness": ("acceleration", lambda: measure_stiffness(stretch())),
        "backlash": ("reversals", lambda: measure_backlash(stretch(), machine)),
        "equability": ("friction", lambda: measure_equability(_all_of(with_torque()))),
        "signature": ("signature", orders),
        "reversal_error": ("reversals", lambda: measure_reversal_error(_all_of(prepared(names)))),
        "frequency_response": ("multisine", lambda: measure_response(frames)),
        "inertia": ("acceleration", lambda: _measure_inertia(machine, frames)),
    }
    sections = {name: examined(motion, measure) for name, (motion, measure) in tests.items()}
    if sections["friction_runs"].status is Status.UNDETERMINED:
        del sections["friction_runs"]  # a session that tests friction once lacks nothing
    fresh_stiffness = fresh.sections["stiffness"].figures if fresh else {}
    sections["preload"] = examined(
        "friction",
        lambda: measure_preload(
            sections["friction"].figures.get("coulomb_nm"),
            sections["stiffness"].figures,
            fresh_stiffness,
            machine,
        ),
    )
    return AxisFingerprint(machine.axis.name, tuple(names), sections)


def _measure_inertia(machine: Machine, frames: Sequence[SampleFrame]) -> Contents:
    """Inertia with the friction of the rigid model, which needs no constant speed."""
    able = [frame for frame in frames if TORQUE in frame.channels]
    if not able:
        raise ValueError(f"no recording has {TORQUE}")
    each = (_settings(machine, [frame]) for frame in able)
    fit = identify_inverse_dynamics(able, min(each, key=lambda one: one.cutoff_hz))
    inertia = fit.parameters["inertia"]
    clock = clock_of([frame.time_s for frame in able])
    why = "too little acceleration: it is not told from none" * (inertia.low <= 0.0)
    why = TOO_SLOW.format(clock.rate_hz) if clock.is_slow else why
    inertia = undetermined(inertia.unit, why) if why else inertia
    found = {"inertia_kg_m2": inertia, "rigid_coulomb_nm": fit.parameters["coulomb"]}
    return found | {"rigid_viscous_nm_s_per_rad": fit.parameters["viscous"]}, ()


def _all_of(parts: Mapping[str, Sequence[_T]]) -> tuple[_T, ...]:
    return tuple(itertools.chain.from_iterable(parts.values()))


def _settings(machine: Machine, frames: Sequence[SampleFrame]) -> PreparationSettings:
    ratio_m_per_rad = machine.transmission_ratio_m_per_rad
    return PreparationSettings.sampled(ratio_m_per_rad, frames, CUTOFF_HZ)
