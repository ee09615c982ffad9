"""Sessions of a life on either plant: what an estimator gets of them, and the truth."""

from typing import Any

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.samples import Floats, SampleFrame

from ... import foreign_plant as plant
from ..estimator.axis import BEARING_NM, GUIDE_N, RATE_HZ, OwnAxis, downsampled
from ..estimator.plants.foreign import commissioned_machine, recorded
from ..estimator.scores import Recorded
from .cases import Session

WARM_SHARE, TIME_CONSTANT_S = 0.3, 600.0
"""Of the dry friction that a warm axis has lost, and how long it takes."""
GROWTH_K = 4.0


class ForeignLife:
    name = "foreign"

    def __init__(self, axis_seed: int) -> None:
        self._axis_seed = axis_seed
        self.fresh_percent = plant.Machine().preload_percent

    def recorded(self, session: Session) -> Recorded:
        return recorded(self.case(session), clock_s=session.clock_s)

    def case(self, session: Session) -> Any:
        rng = np.random.default_rng([session.seed, 31])
        warmup = plant.Warmup(time_constant_s=TIME_CONSTANT_S, start=session.warmth)
        lubricant = plant.Lubricant(session.guide, session.nut, session.bearing, session.viscous)
        return plant.axis_case(
            (np.array(session.time_s), np.array(session.percent)),
            setpoint_m=plant.part_programme(rng, session.duration_s),
            events=(warmup, lubricant, plant.Payload(((0.0, session.added_kg),))),
            seed=session.seed,
            axis_seed=self._axis_seed,
        )

    def estimator(self) -> MixturePreloadEstimator:
        return MixturePreloadEstimator(commissioned_machine(self._axis_seed))


class OwnLife:
    name = "own"

    def __init__(self, axis_seed: int) -> None:
        self._axis = OwnAxis(axis_seed)
        self.fresh_percent = self._axis.fresh_percent

    def recorded(self, session: Session) -> Recorded:
        count = round(session.duration_s * RATE_HZ)
        time_s = np.arange(count) / RATE_HZ
        percent: Floats = np.interp(time_s, session.time_s, session.percent)
        added = np.full(count, session.added_kg)
        effects = self.effects(session)
        frames = self._axis.frames(
            "production", percent, session.seed, effects, session.nut, added_mass_kg=added
        )
        later = (SampleFrame(x.time_s + session.clock_s, x.channels) for x in frames)
        blocks = downsampled(later, self._axis.nominal())
        return Recorded(blocks, time_s + session.clock_s, percent)

    def effects(self, session: Session) -> tuple[str, ...]:
        """Warmth, growth and the friction of guides, bearings and lubricant as effects."""
        machine = self._axis.commissioned()
        assert machine.commissioned is not None
        faded_nm = WARM_SHARE * machine.commissioned.coulomb_nm
        cold = 1.0 - session.warmth
        ratio = machine.transmission_ratio_m_per_rad
        guide_nm = GUIDE_N * ratio * (session.guide - 1.0)
        change_nm = guide_nm + BEARING_NM * (session.bearing - 1.0) - faded_nm
        viscous = machine.model.viscous_nm_s_per_rad.value * (session.viscous - 1.0)
        return (
            f"drag_error:change_nm={change_nm}",
            f"warmup:excess_nm={faded_nm * cold},time_constant_s={TIME_CONSTANT_S}",
            f"thermal_growth:rise_k={GROWTH_K * cold},time_constant_s={1.5 * TIME_CONSTANT_S}",
            f"viscous_error:change_nm_s_per_rad={viscous}",
        )

    def estimator(self) -> MixturePreloadEstimator:
        return MixturePreloadEstimator(self._axis.commissioned())


def plant_of(name: str, axis_seed: int) -> OwnLife | ForeignLife:
    return OwnLife(axis_seed) if name == OwnLife.name else ForeignLife(axis_seed)
