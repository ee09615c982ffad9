"""Cost of the simulated plant: processor time for 100 s of axis time."""

import statistics
import time

import numpy as np

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits

from ..table import Figure

AXIS_TIME_S = 100.0
RATE_HZ = 1000.0
AIM_S = 1.0
TYPICAL_EFFECTS = (
    "stribeck",
    "torque_ripple",
    "position_friction",
    "lead_error",
    "backlash",
    "warmup",
    "load_offset",
    "encoder_eccentricity",
)


def plant_figures(repeats: int) -> list[Figure]:
    """Processor time of one core for 100 s, without effects and with eight of them."""
    cases = (("plain", "no effects", ()), ("effects", "eight effects", TYPICAL_EFFECTS))
    return [
        Figure(
            f"plant_{key}_s",
            f"simulated plant: 100 s of axis time, {name}",
            _processor_s(effects, repeats),
            "s",
            AIM_S,
        )
        for key, name, effects in cases
    ]


def _processor_s(effects: tuple[str, ...], repeats: int) -> float:
    """Median of `repeats` runs, the kernels compiled before, s."""
    machine = load_machine(DEFAULT_MACHINE)
    limits = motion_limits(machine)
    active = [parse_effect(effect) for effect in effects]
    settings = FeedDriveSettings.of_machine(machine, RATE_HZ, active)
    segments = MOTIONS["production"](limits, np.random.default_rng(1))
    setpoints = Setpoints(segments, limits.low_m, RATE_HZ).take(round(AXIS_TIME_S * RATE_HZ))
    preload = np.full(len(setpoints), machine.fresh_preload_percent or 0.0)
    spent = []
    for rows in (100, *[len(setpoints)] * repeats):
        drive = FeedDrive(settings, limits.low_m, float(preload[0]), 1)
        begun_s = time.process_time()
        drive.advance(setpoints[:rows], preload[:rows])
        spent.append(time.process_time() - begun_s)
    return statistics.median(spent[1:])
