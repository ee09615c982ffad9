"""Recordings of a healthy, cold axis in, a commissioned machine file out."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from ..atomic import write_whole
from ..command_answer import Answer, progress
from ..config import ConfigError, EstimatorConfig, load_machine
from ..diagnose.candidates.regressors import STEADY
from ..estimate.commissioning.identification import commissioned
from ..estimate.commissioning.phases import CommissioningError, observed_limits
from ..estimate.commissioning.shares import doubt_of_fresh_screw, learned_notch
from ..fingerprint.response.notch import notch_of
from ..messages.features import FeatureBlock
from ..messages.interval import Interval, printed
from ..messages.samples import Floats
from ..models.commissioned import Notch
from ..models.machine import Machine, ModelConfig
from ..models.steady_limits import SteadyLimits, steady_limits
from ..nodes.stages import make_downsampler, make_estimator
from .diagnosis.gap import DiagnosisError, gap_of
from .machine_text import drag_of
from .recordings import examine, failing, open_recording, read_recording, reported, require_sound
from .report.quantities import tolerated

READ_BACK = 6000
"""Blocks, of all recordings alike, that the estimator reads back: some 10 s of computing."""
LEAST_UNIX_S, OTHER_DAY_S = 1e9, 12.0 * 3600.0
"""UNIX time that no uptime reaches; least time between tests of two days."""
SELDOM = 0.05
"""Share of its answers that an interval of 95 % may miss."""


def commission_to_file(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path,
    axis_number: int | None = None,
    tests: Sequence[Path] = (),
    interval_s: float | None = None,
    *,
    assume_fresh: bool = False,
) -> Answer:
    """Write the commissioned machine file; returns what was learned.

    Args:
        tests: recordings of `motion chirp`, of different days, for an axis with one encoder.
        interval_s: of the blocks from now on; that of the machine file unless given.
        assume_fresh: take the screw for fresh where recordings and data sheet contradict it. Where
            they leave it open it is assumed, said, and kept in the file.

    Raises ConfigError, TraceError, ExaminationError.
    """
    if any(out.resolve() == given.resolve() for given in (*traces, *tests)):
        raise ConfigError(f"--out {out}: would overwrite a recording; choose another file")
    stated = load_machine(machine_file, axis_number)
    nominal, model = _unloaded(stated), stated.model
    if model.preload_n is not None and model.preload_drag_nm is None:  # by (4.3.6)
        diameter_m = stated.axis.screw_diameter_m or 0.0
        sheet = {"preload_n": model.preload_n.value, "screw_diameter_m": diameter_m}
        drag = {"preload_drag_nm": drag_of(sheet, stated.axis.lead_m)}
        nominal = nominal.model_copy(update={"model": model.model_copy(update=drag)})
    require_sound(examine(nominal, traces), traces, strict=("columns", "torque"))
    if interval_s is None and nominal.commissioned is not None:
        interval_s = nominal.commissioned.interval_s
    uncommissioned = nominal.model_copy(update={"commissioned": None})
    limits = steady_limits(uncommissioned)
    recordings, hold_s = _read(traces, uncommissioned, limits, interval_s)
    observed = observed_limits(recordings)
    if observed != limits:
        recordings, hold_s = _read(traces, uncommissioned, observed, interval_s)
    progress("identifying the axis")
    try:
        machine = commissioned(recordings, nominal, observed)
    except CommissioningError as error:
        raise ConfigError(f"{', '.join(map(str, traces))}: {error}") from error
    doubt = doubt_of_fresh_screw(nominal, machine)
    more: dict[str, Any] = {"hold_s": tuple(hold_s.round(6).tolist()), "interval_s": interval_s}
    assert machine.commissioned is not None
    shaken, dated = _notches(nominal, tests)
    if shaken:
        if machine.commissioned.transmission is not None:
            raise ConfigError("--test: two encoders show the stiffness; commission without tests")
        more["notch"] = learned_notch(shaken, nominal, machine)
    if doubt is not None:
        if doubt.contradicts and not assume_fresh:
            healthy = "if it is healthy all the same: --assume-fresh"
            raise ConfigError(f"{traces[0]}: {doubt.words}; {healthy}")
        more["assumed_fresh"] = True
    with suppress(DiagnosisError):  # runs that are too short to be compared
        more["gap"] = gap_of(machine, traces)
    learned = machine.commissioned.model_copy(update=more)
    machine = machine.model_copy(update={"commissioned": learned})
    progress("reading the recordings back")
    unlike = _not_as_fresh(machine, traces, recordings)
    document = tomlkit.parse(machine_file.read_text("utf-8-sig"))
    if axis_number is not None:
        document["axis"]["number"] = axis_number
    _write_model(document, machine, stated)
    write_whole(out, tomlkit.dumps(document))
    said = zip(map(str, traces), map(failing, recordings), strict=True)
    failed = {name: words for name, words in said if words}
    return _learned(out, machine, None if doubt is None else doubt.words, unlike, dated, failed)


def _unloaded(stated: Machine) -> Machine:
    """The machine without a constant load, which is learned: the estimator must know what hangs."""
    shares = [getattr(e.parameters.get("asymmetry_nm"), "value", 1.0) for e in stated.effects]
    kept = (e for e, x in zip(stated.effects, shares, strict=True) if x or e.name != STEADY)
    return stated.model_copy(update={"effects": tuple(kept)})


def _not_as_fresh(
    machine: Machine, traces: Sequence[Path], recordings: Sequence[Sequence[FeatureBlock]]
) -> dict[str, Interval]:
    """Worst reading, percent of the fresh preload, of each recording that is not read as fresh.

    What an axis was learned from must read as fresh: tomorrow's estimates have the same error.
    """
    unlike: dict[str, Interval] = {}
    fresh = machine.fresh_preload_percent
    if fresh is None or machine.missing_for_percent() is not None:
        return unlike
    for trace, blocks in zip(traces, recordings, strict=True):
        estimator = make_estimator(EstimatorConfig(), machine)
        seen = []
        for block in blocks[: READ_BACK // len(recordings)]:
            estimator.update(block)
            now = estimator.estimate()
            if now.preload_percent is not None and now.low is not None and now.high is not None:
                reading = Interval(value=now.preload_percent, low=now.low, high=now.high)
                seen.append(reading.times(100.0 / fresh))
        missed = [each for each in seen if not each.low <= 100.0 <= each.high]
        if len(missed) > SELDOM * len(seen):
            worst = max(missed, key=lambda each: max(each.low - 100.0, 100.0 - each.high))
            unlike[str(trace)] = worst
    return unlike


def _read(
    traces: Sequence[Path], machine: Machine, limits: SteadyLimits, interval_s: float | None
) -> tuple[list[list[FeatureBlock]], Floats]:
    """Blocks of each recording, and for how long its channels repeat a value, s, (3,)."""
    found, hold_s = [], np.zeros(3)
    for trace in traces:
        downsampler = make_downsampler(machine, limits, interval_s)
        with open_recording(machine, trace) as reader:
            frames = reported(reader, f"reading {trace.name}")
            found.append([block for frame in frames for block in downsampler.push(frame)])
        hold_s = np.maximum(hold_s, downsampler.hold_s)
    return found, hold_s


def _notches(machine: Machine, tests: Sequence[Path]) -> tuple[list[Notch], bool]:
    """Notch of each test, and whether the days of all are known. Raises ConfigError."""
    found, begun_s = [], []
    for test in tests:
        try:
            recording = read_recording(machine, test)
            notch = notch_of(recording)
        except ValueError as error:
            raise ConfigError(f"--test {test}: {error}") from error
        if notch is None:
            nothing = "nothing shakes the axis on a slow feed (motion chirp)"
            raise ConfigError(f"--test {test}: {nothing}")
        found.append(notch)
        begun_s.append(float(np.fmin.reduce(recording.time_s)))
    on_days = sorted(each for each in begun_s if each > LEAST_UNIX_S)
    is_twice = len({each.antiresonance_hz for each in found}) < len(found)
    if is_twice or np.any(np.diff(on_days) < OTHER_DAY_S):
        twice = "the same recording twice, or two of one day"
        raise ConfigError(f"--test: {twice}; each must be of another day")
    return found, len(on_days) == len(found)


def _write_model(document: tomlkit.TOMLDocument, machine: Machine, nominal: Machine) -> None:
    model = document["model"]
    for name in ModelConfig.model_fields:
        quantity = getattr(machine.model, name)
        if quantity is None:
            model.pop(name, None)
        elif quantity != getattr(nominal.model, name):
            model[name] = tomlkit.inline_table()
            model[name].update({"value": quantity.value, "tolerance": quantity.tolerance})
    assert machine.commissioned is not None
    document.pop("commissioned", None)
    learned = tomlkit.table()
    values = machine.commissioned.model_dump(mode="json", exclude_none=True)
    for name in sorted(values, key=lambda name: isinstance(values[name], dict)):  # tables come last
        learned[name] = values[name]
    effects = document.pop("effects", [])  # tables after an array of tables would join it
    document["commissioned"] = learned
    for k in [k for k, each in enumerate(nominal.effects) if each not in machine.effects][::-1]:
        del effects[k]
    if effects:
        document["effects"] = effects


def _learned(
    out: Path,
    machine: Machine,
    doubt: str | None,
    unlike: Mapping[str, Interval],
    dated: bool,
    failed: Mapping[str, str],
) -> Answer:
    model, learned = machine.model, machine.commissioned
    assert learned is not None
    guide, drag = model.guide_force_n, model.bearing_drag_nm
    guides = f"{guide.value:.3g} N" if guide.value > 1.96 * guide.sigma else "not told from none"
    bearings = f"{drag.value:.3g} N m" if drag.value > 1.96 * drag.sigma else "not told from none"
    transmission, mass = learned.transmission, model.table_mass_kg
    lines = [
        f"{out}: commissioned",
        f"from {learned.motion_s:.0f} s of steady motion:",
        *(f"  {name}: {words}" for name, words in failed.items()),
        f"  inertia {tolerated(model.inertia_kg_m2, 'kg m2')}",
        f"  viscous friction {tolerated(model.viscous_nm_s_per_rad, 'N m s/rad')}",
        f"  Coulomb friction {learned.coulomb_nm:.4g} N m in all, of it "
        f"guides {guides}, bearings {bearings}",
    ]
    stretch: dict[str, float | bool] | None = None
    if transmission is None or mass is None:
        lines.append(
            "  no stretch between two encoders: preload will rest on torque alone, and its "
            "interval will hold what warm-up and lubrication may do to friction, but for --test"
        )
    else:
        is_stated = model.nut_stiffness_n_per_m is not None
        stretch = {
            "stiffness_n_per_m": mass.value / transmission.stretch_per_acceleration_s2,
            "reference_m": transmission.reference_m,
            "nut_share": transmission.nut_share,
            "nut_share_sigma": transmission.nut_share_sigma,
            "nut_stiffness_is_stated": is_stated,
        }
        lines.append(
            f"  series stiffness {stretch['stiffness_n_per_m']:.3g} N/m at "
            f"{transmission.reference_m:.3g} m, "
            f"nut's share {transmission.nut_share:.2f} +- {transmission.nut_share_sigma:.2f}"
        )
        if not is_stated:
            lines += ["  model.nut_stiffness_n_per_m is not stated: intervals carry the ignorance"]
    if (notch := learned.notch) is not None:
        lines.append(
            f"  antiresonance {notch.antiresonance_hz:.4g} Hz by {notch.repeats} tests, compliance "
            f"+- {100.0 * notch.compliance_scatter:.2g} % from day to day, nut's share "
            f"{notch.nut_share:.2f} +- {notch.nut_share_sigma:.2f}"
        )
        if not dated:
            lines.append(
                "  the days of the tests are not known: own clocks; tests of one day scatter less "
                "than the axis does from day to day, and make the answers too sure"
            )
    if doubt is not None:
        lines.append(f"  the screw is assumed to be fresh: {doubt}")
    for name, read in unlike.items():
        value, low, high = printed(read.value, read.low, read.high)
        lines.append(
            f"  {name} reads as {value} % of the fresh preload ({low} to {high}): another state of "
            "the axis, or a model that does not fit; commission without it, or expect that error"
        )
    document = {"out": str(out), "motion_s": learned.motion_s, "coulomb_nm": learned.coulomb_nm}
    document |= {"guide_force_n": guide.value, "bearing_drag_nm": drag.value}
    viscous = model.viscous_nm_s_per_rad
    document |= {"inertia_kg_m2": model.inertia_kg_m2, "viscous_nm_s_per_rad": viscous}
    document |= {"stretch": stretch, "notch": learned.notch, "failing": failed}
    document |= {"assumed_fresh_because": doubt, "not_as_fresh_percent": unlike}
    return Answer("\n".join(lines), document)
