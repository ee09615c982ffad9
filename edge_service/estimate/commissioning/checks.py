"""Refusal of recordings that leave a quantity undetermined or contradict the machine file.

A wrong number with a narrow interval is worse than none: every estimate rests on it. Torque and
motion that are not of the same moment, or too coarse, show by their lag, and by wide windows.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from ...checks.finding import looks_wrong
from ...checks.torque import INERTIA_FACTOR
from ...messages.features import FeatureBlock
from ...messages.samples import TORQUE, Floats
from ...models.commissioned import TransmissionConfig
from ...models.machine import GRAVITY_M_S2, Machine, Quantity
from .phases import CommissioningError, SteadyPhases, place_columns, robust_regression
from .shares import SIGMAS, guide_drag, other_drag_nm
from .torque_balance import TorqueBalance

UNEXPLAINED = 0.4
"""Share of the torque's rms that motion may leave unexplained."""
MOVE_SCATTER = 0.05
"""Scatter of friction from move to move over friction: a healthy axis has the same in all."""
LONGEST_LAG_S = 4e-3
"""Filters and cycles of drives delay torque by 0.3 to 2 ms."""
OTHER_FACTOR, STATED_FACTOR = 10.0, 2.0
"""Friction that may stand beside the screw's own where no weight is known, and over the stated."""
WORN_SHARE = 0.7
"""Share of the fresh screw's drag: a healthy screw, run in and cold, has more."""
SEALS_N = 200.0
"""Carriages with double seals and scrapers (catalogues: 5 to 50 N each), strips of light axes."""
BEARING_NM_PER_M = 11.0
"""Sealed thrust bearings by the screw's diameter (INA ZKLF: 0.015 N m a mm of bore, 3/4 of it)."""
NUT_SHARES = (0.03, 1.0)
"""Nut's share of the series compliance: screw, bearings and coupling are softer than nothing."""
LEAST_PHASES = 20
"""Least number of phases between two others for a lag."""
TOUCHING = 0.3
"""Tolerance of the way between two touching phases against that at their speeds, as a share."""
LEAST_WINDOWS = 20
SURE = 0.1
"""Relative standard deviation beyond which inertia or friction is not known."""
LEAST_MOVING = 0.9
"""Share of an interval in motion below which its torque may be anything."""
_EDGE_SLACK = 1e-3


def require_identified(
    phases: SteadyPhases, torque: TorqueBalance, doubt_kg_m2: float, machine: Machine
) -> None:
    """Require a torque balance that is determined, and is the one of this machine file.

    `doubt_kg_m2` is by how much the inertia differs between windows (inertia_doubt).

    Raises:
        CommissioningError: it is not; the text names the finding and its remedy.
    """
    lag = torque_lag(phases)
    if lag is not None and abs(lag[0]) - SIGMAS * lag[1] > LONGEST_LAG_S:
        way = "later" if lag[0] > 0.0 else "earlier"
        raise CommissioningError(
            f"torque is {1e3 * abs(lag[0]):.2g} ms {way} than the acceleration it causes "
            f"(expected less than {1e3 * LONGEST_LAG_S:.2g}): needs columns.{TORQUE} unfiltered "
            "and sampled with the position"
        )
    found, stated = torque.inertia_kg_m2, machine.model.inertia_kg_m2
    if doubt_kg_m2 > SURE * found:
        raise CommissioningError(
            f"inertia changes with the window: {found:.3g} kg m2 from sample to sample, "
            f"{doubt_kg_m2:.2g} off over intervals (expected less than {100.0 * SURE:.0f} %): "
            "needs faster samples, a finer encoder, torque sampled with the position, or "
            "recordings without process forces"
        )
    apart = abs(found - stated.value) > SIGMAS * float(np.hypot(torque.inertia_sigma, stated.sigma))
    least, most = stated.value / INERTIA_FACTOR, stated.value * INERTIA_FACTOR
    if apart and not least <= found <= most:
        raise CommissioningError(
            f"{looks_wrong('torque', found / stated.value)}: inertia reads {found:.3g} kg m2, not "
            f"{stated.value:.3g}: check model.inertia_kg_m2, axis.lead_m, columns.{TORQUE}.scale"
        )
    if torque.unexplained > UNEXPLAINED:
        raise CommissioningError(
            f"motion explains too little of the torque: {100.0 * torque.unexplained:.0f} % of it "
            f"is left (expected less than {100.0 * UNEXPLAINED:.0f}): needs recordings without "
            "process forces, or faster samples"
        )
    share = torque.move_scatter_nm / torque.coulomb_nm
    if share > MOVE_SCATTER:
        raise CommissioningError(
            f"friction differs from move to move by {100.0 * share:.2g} % (expected less than "
            f"{100.0 * MOVE_SCATTER:.0f}): needs recordings of one cold day, without "
            "process forces, such as the same program without a workpiece"
        )
    for name, value, sigma, motion in (
        ("inertia", torque.inertia_kg_m2, torque.inertia_sigma, "acceleration"),
        ("friction", torque.coulomb_nm, torque.coulomb_sigma, "friction"),
    ):
        if sigma > SURE * value:
            raise CommissioningError(
                f"{name} is known only to within {100.0 * sigma / value:.2g} % (expected "
                f"{100.0 * SURE:.0f}): needs longer recordings of `edge-service motion {motion}`, "
                "or faster samples"
            )


def require_fresh_screw(
    torque: TorqueBalance, machine: Machine, transmission: TransmissionConfig | None
) -> None:
    """Require the friction of a fresh screw and of plausible guides and bearings.

    The wind-up at reversals shows the guides' friction; the rest is the screw's and the bearings'.

    Raises:
        CommissioningError: it is not, so the screw is worn or warm, or a unit is another.
    """
    screw = machine.model.preload_drag_nm
    if screw is None or machine.model.preload_n is None:
        return
    guide = guide_drag(machine, transmission) or Quantity(value=0.0)
    whole = f"the axis shows {torque.coulomb_nm:.3g} N m of Coulomb friction"
    if screw.value > 1.1 * torque.coulomb_nm:
        raise CommissioningError(
            f"{whole}, less than the fresh screw's own {screw.value:.3g} N m "
            "(model.preload_drag_nm): not healthy, wrong units, or another model.preload_n"
        )
    bearing = machine.model.bearing_drag_nm
    left_nm = torque.coulomb_nm - guide.value - bearing.value
    sigma = float(np.sqrt(torque.coulomb_sigma**2 + guide.sigma**2 + bearing.sigma**2))
    if left_nm + SIGMAS * sigma < WORN_SHARE * screw.value:
        worn = "worn or warm; needs a healthy, cold axis, or" if left_nm > 0.0 else "needs"
        known_nm, shares = SIGMAS * torque.coulomb_sigma, {"guides": guide, "bearings": bearing}
        told = [f"{e.value:.3g} in the {name}" for name, e in shares.items() if e.value > known_nm]
        raise CommissioningError(
            f"{whole}, {' and '.join([*told, f'{left_nm:.3g} left for the screw'])}, fresh "
            f"{screw.value:.3g} (model.preload_drag_nm): {worn} the right model.table_mass_kg"
        )


def require_stated_nut(machine: Machine, transmission: TransmissionConfig | None) -> None:
    """Require an axis that is softer than its nut alone, but not by far.

    Raises:
        CommissioningError: the stretch contradicts the nut's stiffness or the table's mass.
    """
    nut, mass = machine.model.nut_stiffness_n_per_m, machine.model.table_mass_kg
    if transmission is None or nut is None or mass is None:
        return
    stiffness = mass.value / transmission.stretch_per_acceleration_s2
    share, low, high = stiffness / nut.value, *NUT_SHARES
    doubt = 1.0 + SIGMAS * float(np.hypot(nut.tolerance, mass.tolerance))
    if low / doubt <= share <= high * doubt:
        return
    raise CommissioningError(
        f"the stretch shows a series stiffness of {stiffness:.3g} N/m, "
        f"{'more' if share > high else 'far less'} than the nut's own {nut.value:.3g} "
        "(model.nut_stiffness_n_per_m) allows: check it, model.table_mass_kg and the encoders"
    )


def require_light_guides(torque: TorqueBalance, machine: Machine) -> None:
    """Require friction that weight or seals, bearings and what the file states of guides explain.

    Raises:
        CommissioningError: another force brakes the axis all the time, or a unit is another.
    """
    model, ratio = machine.model, machine.transmission_ratio_m_per_rad
    mass, screw_nm = model.table_mass_kg, machine.fresh_drag_nm
    if mass is None and not screw_nm:
        return
    weight_n = OTHER_FACTOR * screw_nm / ratio
    if mass is not None:
        weight_n = GRAVITY_M_S2 * mass.value * (1.0 + SIGMAS * mass.tolerance)
    bearing_nm = BEARING_NM_PER_M * (machine.axis.screw_diameter_m or 0.0)
    most_n = max(weight_n, SEALS_N, STATED_FACTOR * model.guide_force_n.value)
    most_n += max(bearing_nm, model.bearing_drag_nm.value) / ratio
    force_n = other_drag_nm(machine, torque) / ratio
    if force_n > most_n:
        raise CommissioningError(
            f"friction beside the screw's is {force_n:.3g} N, more than the table weighs and than "
            f"seals and bearings hold back ({most_n:.3g} N): needs recordings without process "
            "forces, the guides' own in model.guide_force_n, or the right model.table_mass_kg, "
            f"model.preload_drag_nm and scale of columns.{TORQUE}"
        )


def torque_lag(phases: SteadyPhases) -> tuple[float, float] | None:
    """Lag of the torque behind the motion it makes, and its standard deviation, s.

    A torque that is late by tau reads J (a(t - tau)): its mean over a phase misses
    J tau (a_end - a_begin) / steady_s, where the accelerations at both borders come from the phases
    beside it. Motion of the shaft needs no finer samples than that. None where hardly any phase
    lies between two others.
    """
    order = np.lexsort((phases.angle_rad * phases.direction, phases.time_s, phases.run))
    phases = phases.at(order)
    if len(phases) < LEAST_PHASES:
        return None
    steady_s, acceleration = phases.steady_s, phases.acceleration_rad_s2
    way = 0.5 * np.abs(phases.speed_rad_s) * steady_s
    expected = way[:-1] + way[1:]
    touching = (np.diff(phases.run) == 0.0) & (np.diff(phases.direction) == 0.0)
    touching &= np.abs(np.abs(np.diff(phases.angle_rad)) - expected) <= TOUCHING * expected
    inner = np.zeros(len(phases), dtype=bool)
    inner[1:-1] = touching[:-1] & touching[1:]
    if np.count_nonzero(inner) < LEAST_PHASES:
        return None
    share = steady_s[:-1] / (steady_s[:-1] + steady_s[1:])
    border = acceleration[:-1] + share * np.diff(acceleration)
    jerk = np.diff(border, prepend=border[:1], append=border[-1:]) / steady_s
    rows, v = phases.at(inner), phases.speed_rad_s[inner]
    motion = [rows.acceleration_rad_s2, v, np.abs(v), rows.direction]
    columns = np.column_stack([*motion, np.ones(len(rows)), -jerk[inner]])
    fit = robust_regression(columns, rows.torque_nm, rows, np.full(columns.shape[1], np.inf))
    inertia = float(fit.value[0])
    if inertia <= 0.0:
        return None
    return float(fit.value[-1]) / inertia, float(fit.sigma[-1]) / inertia


def inertia_doubt(recordings: Sequence[Sequence[FeatureBlock]], torque: TorqueBalance) -> float:
    """Standard deviation, kg m2, by which the inertia of short windows misses that of wide ones.

    Phases difference the angle over a few milliseconds. Where the encoder is coarse, the samples
    are slow or the torque comes late, that shrinks the inertia; over windows of whole intervals it
    does not. Both are the same divided second difference, of the angle and of the torque integrated
    twice, so both give the same inertia of a true axis (thesis, eq. 4.3.4). What parts them beyond
    what friction and noise explain is doubt, as between two laboratories (DerSimonian, Laird 1986).
    """
    runs = [(k, run) for k, blocks in enumerate(recordings) for run in _unbroken(blocks)]
    found = [_windows(k, run) for k, run in runs if len(run) >= 2]
    rows = SteadyPhases(*np.concatenate([np.empty((9, 0)), *found], axis=1))
    if len(rows) < LEAST_WINDOWS:
        return 0.0
    place = place_columns(rows)
    motion = [rows.acceleration_rad_s2, rows.speed_rad_s, rows.direction, np.ones(len(rows))]
    columns = np.column_stack([*motion, place])
    level = float(np.median(np.abs(rows.torque_nm)))
    prior_sigma = np.array([np.inf] * 4 + [0.5 * level] * place.shape[1])
    fit = robust_regression(columns, rows.torque_nm, rows, prior_sigma)
    # friction that the model leaves over is the same in all moves, and more of them do not average
    # it out; all of it along the acceleration is the most it can do (Cauchy, Schwarz): three sigmas
    left = fit.residual / np.sqrt(fit.noise.variance(rows.steady_s, rows.speed_rad_s))
    by_friction = float(fit.sigma[0]) * max(float(np.linalg.norm(left)) / SIGMAS, 1.0)
    apart = abs(float(fit.value[0]) - torque.inertia_kg_m2)
    if by_friction > SURE * torque.inertia_kg_m2 and apart < SIGMAS * by_friction:
        return 0.0  # intervals cannot tell
    return float(np.sqrt(max(apart**2 - by_friction**2 - torque.inertia_sigma**2, 0.0)))


def _unbroken(blocks: Sequence[FeatureBlock]) -> Iterator[list[FeatureBlock]]:
    """Intervals in motion, parted where one is missing."""
    run: list[FeatureBlock] = []
    for block in blocks:
        able = block.usable and block.moving_fraction >= LEAST_MOVING
        gap_s = abs(block.time_s - block.duration_s - run[-1].time_s) if run else 0.0
        if run and not (able and gap_s <= _EDGE_SLACK * block.duration_s):
            yield run
            run = []
        if able:
            run.append(block)
    if run:
        yield run


def _windows(number: int, run: Sequence[FeatureBlock]) -> Floats:
    """Means under windows of two intervals, as rows of SteadyPhases, (9, n).

    A path of time, angle and second integrals at the ends of the intervals gives them.
    """
    steps_s = np.array([each.duration_s for each in run])[:, None]
    mean = np.array([[each.torque_mean_nm, 0.0, each.direction_mean] for each in run])
    lever = np.array([[each.torque_lever_nm, 0.0, each.direction_lever] for each in run])
    once = np.cumsum(mean * steps_s, axis=0) - mean * steps_s
    twice = once * steps_s + lever * steps_s**2
    twice[:, 1] = [each.angle_mean_rad * each.duration_s for each in run]
    angle = [run[0].angle_start_rad, *(each.angle_end_rad for each in run)]
    integrals = np.vstack([np.zeros(3), np.cumsum(twice, axis=0)])
    path = np.column_stack([np.concatenate([[0.0], np.cumsum(steps_s)]), angle, integrals])
    before, here, behind = path[:-2], path[1:-1], path[2:]
    came = (here - before) / (here[:, :1] - before[:, :1])
    goes = (behind - here) / (behind[:, :1] - here[:, :1])
    span_s = behind[:, 0] - before[:, 0]
    _, acceleration, torque, speed, direction = (2.0 * (goes - came) / span_s[:, None]).T
    unknown = np.full(len(here), np.nan)
    steady = (np.full(len(here), float(number)), here[:, 0], span_s, direction)
    return np.array([*steady, torque, acceleration, speed, here[:, 1], unknown])
