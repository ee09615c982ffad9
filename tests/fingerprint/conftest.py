from collections.abc import Iterable

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import MOTIONS, Segment, Setpoints, motion_limits

GUIDE_FORCE_N = 40.0
BEARING_DRAG_NM = 0.05
FRESH = 100.0 * 510.0 / 7450.0


@pytest.fixture(scope="session")
def bench() -> Machine:
    """The thesis' test bench with guides and bearings that rub."""
    machine = load_machine(DEFAULT_MACHINE)
    model = machine.model.model_copy(
        update={
            "guide_force_n": Quantity(value=GUIDE_FORCE_N),
            "bearing_drag_nm": Quantity(value=BEARING_DRAG_NM),
        }
    )
    return machine.model_copy(update={"model": model})


@pytest.fixture(scope="session")
def settings(bench: Machine) -> FeedDriveSettings:
    return FeedDriveSettings.of_machine(bench)


def run_axis(
    settings: FeedDriveSettings, setpoints: Floats, seed: int, percent: float = FRESH
) -> SampleFrame:
    axis = FeedDrive(settings, float(setpoints[0, 0]), percent, seed)
    return axis.advance(setpoints, np.full(len(setpoints), percent))


def production_setpoints(machine: Machine, count: int, seed: int) -> Floats:
    limits = motion_limits(machine)
    segments = iter(MOTIONS["production"](limits, np.random.default_rng(seed)))
    return Setpoints(segments, limits.low_m, 1000.0).take(count)


def setpoints_of(segments: Iterable[Segment], start_m: float) -> Floats:
    listed = list(segments)
    count = int(sum(np.ceil(1000.0 * segment.duration_s) for segment in listed))
    return Setpoints(iter(listed), start_m, 1000.0).take(count)
