"""The thesis' own open-loop simulations, given to the mixture estimator step by step."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.estimate.mixture.state import LUBRICATION, MixtureSettings
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock, Phase
from edge_service.messages.samples import Floats
from edge_service.models.commissioned import CommissionedConfig
from edge_service.models.machine import AxisConfig, Machine, ModelConfig, Quantity
from edge_service.offline.reproduce import simulation as thesis

from ..scores import Recorded, Score, Track, detection, follow, score
from .own import Part

FRESH_PERCENT = 10.0
RATING_N = 7450.0
_NONE = ("together", "apart", "wear_rate", "rate_walk", "wander", "axial", "loaded")
SETTINGS = MixtureSettings(
    **dict.fromkeys(_NONE, 0.0),
    most_nats=1e3,
    wear_walk=0.055,
    evidence=1.0,
    force_share=1e-6,
    rapid_share=1e-6,
)
"""The thesis' plant has no friction but the screw's, no process, and never another load."""
STUCK_MARGIN_NM = 0.05
"""Torque this close to the highest drag says nothing: the axis may stick."""
THESIS_WINDOW_STEPS = 20
LATE_STEP = 100
ONE_POINT = 6
"""Number of the one-point step beside the thesis' simulations 1 to 4."""


def thesis_machine() -> Machine:
    """The thesis' plant (Table 4.1) as a commissioned machine file, known exactly."""

    def exact(value: float) -> Quantity:
        return Quantity(value=value, tolerance=1e-4)

    fresh_nm = thesis.DRAG_PER_PERCENT_NM * FRESH_PERCENT
    return Machine(
        axis=AxisConfig(lead_m=0.02, dynamic_load_rating_n=RATING_N),
        model=ModelConfig(
            inertia_kg_m2=exact(thesis.INERTIA_KG_M2),
            viscous_nm_s_per_rad=exact(thesis.DAMPING_NM_S_PER_RAD),
            preload_drag_nm=exact(fresh_nm),
            preload_n=exact(FRESH_PERCENT / 100.0 * RATING_N),
        ),
        commissioned=CommissionedConfig(
            coulomb_nm=fresh_nm,
            noise_density_nm2_s=torque_noise_var() * thesis.PRINTED_STEP_S,
            edge_noise_rad2_s2=edge_noise_var(),
            motion_s=thesis.DURATION_S,
            sample_period_s=thesis.PRINTED_STEP_S,
        ),
    )


def thesis_estimator(machine: Machine) -> MixturePreloadEstimator:
    estimator = MixturePreloadEstimator(machine, SETTINGS)
    for priors in (estimator.process.priors, estimator.process.stop_priors):
        priors[LUBRICATION] = -math.inf
    return estimator


def torque_noise_var() -> float:
    """Variance of J times the speed's own noise over T, (N m)^2 (4.6.1)."""
    return float((thesis.INERTIA_KG_M2 / thesis.PRINTED_STEP_S) ** 2 * thesis.PROCESS_VARIANCE[1])


def edge_noise_var() -> float:
    """Variance of a first difference of the angle over T, rad^2/s^2 (4.6.1).

    The angle's own noise, and the encoder's at both ends. Two neighbours share a reading of the
    encoder; taking them as independent is on the safe side.
    """
    bend = thesis.PROCESS_VARIANCE[0] + 2.0 * thesis.READING_VARIANCE[0]
    return float(bend / thesis.PRINTED_STEP_S**2)


def thesis_blocks(run: thesis.ThesisRun) -> list[FeatureBlock]:
    """A block per step: the second difference of the angle is what the torque of a step did.

    The Euler plant moves the angle at k + 2 by the torque of step k; one that may stop gives none.
    """
    step_s, angle = thesis.PRINTED_STEP_S, run.measurement[:, 0]
    surely_slides = (
        np.abs(run.torque_nm) > FRESH_PERCENT * thesis.DRAG_PER_PERCENT_NM + STUCK_MARGIN_NM
    )
    blocks = []
    for k in range(len(angle)):
        informative = k >= 2 and bool(surely_slides[k - 1])
        phase = Phase()
        direction = 0.0
        if informative:
            bend = angle[k] - 2.0 * angle[k - 1] + angle[k - 2]
            speed = float(angle[k - 1] - angle[k - 2]) / step_s
            direction = float(np.sign(run.torque_nm[k - 1]))
            phase = Phase(
                step_s, float(run.torque_nm[k - 1]), float(bend) / step_s**2, speed, 0.0, math.nan
            )
        blocks.append(_block(k, direction, phase))
    return blocks


def _block(step: int, direction: float, phase: Phase) -> FeatureBlock:
    values: dict[str, Any] = dict.fromkeys(FEATURE_FIELDS, math.nan)
    values |= {
        "time_s": (step + 1) * thesis.PRINTED_STEP_S,
        "duration_s": thesis.PRINTED_STEP_S,
        "sample_count": 1,
        "fault": Fault.NONE,
        "direction_mean": direction,
        "direction_lever": 0.5 * direction,
        "moving_fraction": 1.0,
        "reversal_count": 0,
        "steady_direction": direction,
        "accelerating": phase,
    }
    return FeatureBlock(**values)


def thesis_runs(first: int, runs: int) -> Iterator[Part]:
    """Simulations 1 to 4 and a one-point step, `runs` seeds each."""
    machine = thesis_machine()
    for seed in range(first, first + runs):
        for simulation in (1, 2, 3, 4, ONE_POINT):
            run = _simulated(simulation, seed)
            estimator = thesis_estimator(machine)
            truth = Recorded(thesis_blocks(run), run.time_s, run.preload_percent)
            track = follow(estimator, truth)
            ours = _scored(simulation, track)
            theirs = None if simulation == ONE_POINT else _published(simulation, seed)
            name = "one-point step" if simulation == ONE_POINT else f"simulation {simulation}"
            yield Part(f"thesis' {name}, open loop", ours, theirs)
            if simulation != ONE_POINT:
                late = score(track.since(LATE_STEP))
                yield Part(f"thesis' {name}, after step {LATE_STEP}", late)


def _simulated(simulation: int, seed: int) -> thesis.ThesisRun:
    time_s = thesis.PRINTED_STEP_S * np.arange(
        round(thesis.DURATION_S / thesis.PRINTED_STEP_S), dtype=np.float64
    )
    if simulation == ONE_POINT:
        percent = np.where(time_s < 0.5 * thesis.DURATION_S, FRESH_PERCENT, FRESH_PERCENT - 1.0)
    else:
        percent = thesis.preload_profile(simulation, time_s)
    return thesis.simulate(percent, np.random.default_rng(seed))


def _scored(simulation: int, track: Track) -> Score:
    levels = {4: 0.5 * FRESH_PERCENT, ONE_POINT: FRESH_PERCENT - 0.5}
    if simulation not in levels:
        return score(track)
    return score(track, detection_s=detection(track, 0.5 * thesis.DURATION_S, levels[simulation]))


def _published(simulation: int, seed: int) -> Score:
    """The thesis' method with the causal window of 20 steps; it gives no intervals."""
    run, bank = thesis.run_case(thesis.ThesisCase(simulation), seed)
    percent = thesis.smoothed_preload(bank.mode_probability, THESIS_WINDOW_STEPS)
    time_s: Floats = run.time_s + thesis.PRINTED_STEP_S
    truth = run.preload_percent
    return _scored(simulation, Track(time_s, truth, percent, percent, percent, time_s))
