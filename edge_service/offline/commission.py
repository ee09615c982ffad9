"""Recordings of a healthy, cold axis in, a commissioned machine file out."""

from collections.abc import Sequence
from pathlib import Path

import tomlkit

from ..atomic import replaced_file
from ..config import ConfigError, EdgeConfig, load_machine
from ..estimate.commissioning.fresh_screw import doubt_of_fresh_screw
from ..estimate.commissioning.identification import CommissioningError, commissioned
from ..estimate.commissioning.steady_phases import observed_limits
from ..messages.features import FeatureBlock
from ..models.machine import Machine, Quantity
from ..models.steady_limits import SteadyLimits, steady_limits
from ..nodes.wiring.stages import make_downsampler
from .examination import require_sound
from .recordings import open_recording
from .report.quantities import tolerated

_IDENTIFIED = (
    "inertia_kg_m2",
    "viscous_nm_s_per_rad",
    "guide_force_n",
    "bearing_drag_nm",
    "table_mass_kg",
)


def commission_to_file(
    machine_file: Path,
    traces: Sequence[Path],
    out: Path,
    config: EdgeConfig,
    axis_number: int | None = None,
    *,
    assume_fresh: bool = False,
) -> str:
    """Write the commissioned machine file; returns what was learned, in lines.

    Args:
        assume_fresh: take the screw for fresh where recordings and data sheet contradict it. Where
            they leave it open it is assumed, said, and kept in the file.

    Raises:
        ConfigError: a file is wrong, or the recordings cannot determine what is needed.
        TraceError: a recording cannot be read.
        ExaminationError: a unit, a sign or a column is wrong, or the torque is doubtful.
    """
    if any(out.resolve() == given.resolve() for given in traces):
        raise ConfigError(f"--out {out}: would overwrite a recording; choose another file")
    nominal = load_machine(machine_file, axis_number)
    require_sound(nominal, traces, strict=("columns", "torque"))
    uncommissioned = nominal.model_copy(update={"commissioned": None})
    limits = steady_limits(uncommissioned)
    recordings = [_blocks(trace, nominal, config, limits) for trace in traces]
    observed = observed_limits(recordings)
    if observed != limits:
        recordings = [_blocks(trace, nominal, config, observed) for trace in traces]
    try:
        machine = commissioned(recordings, nominal, observed)
    except CommissioningError as error:
        names = ", ".join(str(trace) for trace in traces)
        raise ConfigError(f"{names}: {error}") from error
    doubt = doubt_of_fresh_screw(nominal, machine)
    if doubt is not None:
        if doubt.contradicts and not assume_fresh:
            healthy = "if it is healthy all the same: --assume-fresh"
            raise ConfigError(f"{traces[0]}: {doubt.words}; {healthy}")
        machine = _assumed_fresh(machine)
    document = tomlkit.parse(machine_file.read_text(encoding="utf-8"))
    if axis_number is not None:
        document["axis"]["number"] = axis_number
    _write_model(document, machine)
    with replaced_file(out) as file:
        file.write(tomlkit.dumps(document))
    assumed = [] if doubt is None else [f"  the screw is assumed to be fresh: {doubt.words}"]
    return "\n".join([f"{out}: commissioned", *_summary(machine), *assumed])


def _assumed_fresh(machine: Machine) -> Machine:
    assert machine.commissioned is not None
    learned = machine.commissioned.model_copy(update={"assumed_fresh": True})
    return machine.model_copy(update={"commissioned": learned})


def _blocks(
    trace: Path, machine: Machine, config: EdgeConfig, limits: SteadyLimits
) -> list[FeatureBlock]:
    downsampler = make_downsampler(config.downsample, machine, limits)
    with open_recording(machine, trace) as frames:
        return [block for frame in frames for block in downsampler.push(frame)]


def _write_model(document: tomlkit.TOMLDocument, machine: Machine) -> None:
    model = document["model"]
    for name in _IDENTIFIED:
        quantity = getattr(machine.model, name)
        if quantity is not None:
            model[name] = _inline(quantity)
    assert machine.commissioned is not None
    document.pop("commissioned", None)
    learned = tomlkit.table()
    for name, value in machine.commissioned.model_dump(mode="json", exclude_none=True).items():
        if name != "transmission":
            learned[name] = value
    if machine.commissioned.transmission is not None:
        learned["transmission"] = machine.commissioned.transmission.model_dump(mode="json")
    effects = document.pop("effects", None)  # tables after an array of tables would join it
    document["commissioned"] = learned
    if effects is not None:
        document["effects"] = effects


def _inline(quantity: Quantity) -> tomlkit.items.InlineTable:
    table = tomlkit.inline_table()
    table["value"], table["tolerance"] = quantity.value, quantity.tolerance
    return table


def _summary(machine: Machine) -> list[str]:
    model, learned = machine.model, machine.commissioned
    assert learned is not None
    lines = [
        f"from {learned.motion_s:.0f} s of steady motion:",
        f"  inertia {tolerated(model.inertia_kg_m2, 'kg m2')}",
        f"  viscous friction {tolerated(model.viscous_nm_s_per_rad, 'N m s/rad')}",
        f"  Coulomb friction {learned.coulomb_nm:.4g} N m in all, of it "
        f"guides {model.guide_force_n.value:.3g} N, bearings {model.bearing_drag_nm.value:.3g} N m",
    ]
    transmission = learned.transmission
    if transmission is None:
        lines.append(
            "  no stretch between two encoders: preload will rest on torque alone, and its "
            "interval will hold what warm-up and lubrication may do to friction"
        )
        return lines
    mass = model.table_mass_kg
    assert mass is not None
    stiffness = mass.value / transmission.stretch_per_acceleration_s2
    lines.append(
        f"  series stiffness {stiffness:.3g} N/m at {transmission.reference_m:.3g} m, nut's share "
        f"{transmission.nut_share:.2f} +- {transmission.nut_share_sigma:.2f}"
    )
    if model.nut_stiffness_n_per_m is None:
        lines.append("  model.nut_stiffness_n_per_m is not stated: intervals carry the ignorance")
    return lines
