"""The seed's warm-up study (5.3.4, Figure 5.11): friction runs with warm-up cycles between."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..fingerprint.friction_points import friction_points
from ..fingerprint.preparation import PreparationSettings, prepare
from ..fingerprint.section import Curve
from ..messages.samples import SampleFrame
from ..models.effects.registry import parse_effect
from ..models.feed_drive import FeedDrive, FeedDriveSettings
from ..models.machine import Machine
from ..models.motion import MOTIONS, Setpoints, motion_limits
from ..models.stiffness import CATALOGUE_PRELOAD_PERCENT
from .fingerprint_figures import draw_friction_runs


@dataclass(frozen=True, slots=True)
class WarmupSettings:
    """How the study is run.

    Attributes:
        runs: of the friction test.
        warmup_s: of the cycle between two of them.
        effect: what warming up does.
    """

    runs: int = 5
    warmup_s: float = 300.0
    effect: str = "warmup:excess_nm=0.08,time_constant_s=600"
    seed: int = 1
    rate_hz: float = 1000.0


def warmup_runs(
    machine: Machine,
    settings: WarmupSettings | None = None,
    progress: Callable[[str], None] = lambda _line: None,
) -> dict[str, Curve]:
    """Friction points of each run, by its name; one axis throughout, which warms up as it goes."""
    settings = settings or WarmupSettings()
    limits = motion_limits(machine)
    percent = machine.fresh_preload_percent or CATALOGUE_PRELOAD_PERCENT
    effects = [parse_effect(settings.effect)]
    drive = FeedDrive(
        FeedDriveSettings.of_machine(machine, settings.rate_hz, effects),
        limits.low_m,
        percent,
        settings.seed,
    )

    def record(motion: str, duration_s: float | None) -> SampleFrame:
        random = np.random.default_rng((settings.seed, 1))
        plan = MOTIONS[motion].plan(limits, random, duration_s=duration_s)
        count = round(plan.duration_s * settings.rate_hz)
        setpoints = Setpoints(iter(plan.segments), limits.low_m, settings.rate_hz).take(count)
        return drive.advance(setpoints, np.full(count, percent))

    curves = {}
    for number in range(1, settings.runs + 1):
        progress(f"run {number} of {settings.runs}")
        curves[f"run {number}"] = _friction(machine, record("friction", None))
        if number < settings.runs:
            record("warmup", settings.warmup_s)
    return curves


def warmup_picture(curves: dict[str, Curve]) -> str:
    """All runs over one another, as an SVG element."""
    return draw_friction_runs(curves)


def mean_friction_nm(curve: Curve) -> float:
    """Mean magnitude of the friction of a run, N m: half the width between both directions."""
    levels: Sequence[float] = np.abs(curve.y).tolist()
    return float(np.mean(levels))


def _friction(machine: Machine, frame: SampleFrame) -> Curve:
    settings = PreparationSettings(machine.transmission_ratio_m_per_rad)
    inertia = machine.model.inertia_kg_m2.value
    points = sorted(
        friction_points(prepare(frame, settings), inertia_kg_m2=inertia),
        key=lambda point: point.speed_rad_s,
    )
    return Curve(
        "friction",
        np.array([point.speed_rad_s for point in points]),
        np.array([point.torque_nm for point in points]),
        "motor speed, rad/s",
        "friction torque, N m",
    )
