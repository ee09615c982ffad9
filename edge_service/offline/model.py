"""`edge-service model`: drag, inertia, stiffness and linear models of a drive, by the thesis."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy import io, linalg, signal

from ..atomic import replaced_bytes
from ..command_answer import Answer
from ..config import ConfigError, check_settings
from ..estimate.imm.modes import LEVELS_PERCENT
from ..models.machine import Machine
from ..models.plant.from_machine import (
    COUPLING_NM_PER_RAD,
    SCREW_DIAMETER_M,
    SCREW_LENGTH_M,
    StateSpace,
    chain,
    component_model,
    plant_of,
    table_mass,
)
from ..models.plant.two_mass import Plant, axial_compliance
from ..models.screw.ball_screw import (
    EFFICIENCY,
    lead_angle,
    preload_drag,
    screw_inertia,
    table_inertia,
)
from ..models.screw.nut_law import CATALOGUE_PRELOAD_PERCENT, loaded_nut_stiffness
from .batch import flat
from .machine_text import SECTIONS, Sheet
from .report.page import STYLE, write_png

PLACES, LOADS, STEPS = 5, 6, 200
MOST_SHOWN = 16
"""Numbers of one quantity that are shown to people; files hold all."""
_AT_INFINITY_RAD_S = 1e7


def machine_of(base: Machine, sheet: Sheet, efficiency: float = EFFICIENCY) -> Machine:
    """Machine with other values in it, and what follows from these by the thesis.

    The drag is that of the preload, and screw and table have other inertias, unless they are
    stated. Raises ConfigError.
    """
    content = base.model_dump(exclude_none=True, exclude={"commissioned", "effects"})
    for key, value in sheet.items():
        content.setdefault(SECTIONS[key], {})[key] = value
    made = check_settings(Machine, content, "--set")
    axis, model = made.axis, content["model"]
    if made.model.preload_n is not None and "preload_n" in sheet and "preload_drag_nm" not in sheet:
        given = made.model.preload_n.value, axis.lead_m, _lead_angle(made)
        model["preload_drag_nm"] = preload_drag(*given, efficiency)
    if "inertia_kg_m2" not in sheet:
        more = sum(_inertias(made)) - sum(_inertias(base))
        model["inertia_kg_m2"] = base.model.inertia_kg_m2.value + more
    return check_settings(Machine, content, "--set")


def _lead_angle(machine: Machine) -> float:
    axis = machine.axis
    diameter_m = axis.ball_circle_m or axis.screw_diameter_m or SCREW_DIAMETER_M
    return lead_angle(axis.lead_m, diameter_m)


def _inertias(machine: Machine) -> tuple[float, float]:
    """Inertia of the screw, and of the table at the motor, kg m^2."""
    axis = machine.axis
    length_m = max(axis.screw_length_m or SCREW_LENGTH_M, axis.stroke_m or 0.0)
    screw = screw_inertia(axis.screw_diameter_m or SCREW_DIAMETER_M, length_m)
    return screw, table_inertia(table_mass(machine), axis.lead_m)


def model(
    machine: Machine,
    rate_hz: float,
    efficiency: float = EFFICIENCY,
    export: Path | None = None,
    plot: Path | None = None,
) -> Answer:
    """Compute, and write what is asked for. Raises ConfigError: the file's kind is unknown."""
    document = computed(machine, rate_hz, efficiency)
    members = dict(flat(document))
    if export is not None:
        _export(export, members)
    if plot is not None:
        _draw(plot, document)
    lines = []
    for name, values in members.items():
        if "_poles" in name or "_zeros" in name:
            lines.append(f"{name:<36} {' '.join(f'{re:.5g}{im:+.5g}j' for re, im in values)}")
        elif np.size(values) <= MOST_SHOWN:
            lines.append(f"{name:<36} {' '.join(f'{each:.5g}' for each in np.ravel(values))}")
    lines.append("longer series: --json, --export, --plot")
    return Answer("\n".join(lines), document)


def computed(
    machine: Machine, rate_hz: float, efficiency: float = EFFICIENCY
) -> dict[str, dict[str, Any]]:
    """Quantities by their names, which end with their units; lists run along the stroke."""
    axis = machine.axis
    try:
        plant = plant_of(machine)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    per_n = preload_drag(1.0, axis.lead_m, _lead_angle(machine), efficiency)
    rating_n, fresh = axis.dynamic_load_rating_n, machine.fresh_preload_percent
    percent = CATALOGUE_PRELOAD_PERCENT if fresh is None else fresh
    drag: dict[str, Any] = {"ratio_m_per_rad": machine.transmission_ratio_m_per_rad}
    drag |= {"lead_angle_rad": _lead_angle(machine), "efficiency": efficiency}
    drag |= {"nm_per_n": per_n, "n_per_nm": 1.0 / per_n}
    if stated_nm := machine.fresh_drag_nm:
        drag |= {"stated_nm": stated_nm, "stated_is_of_n": stated_nm / per_n}
    if rating_n is not None:
        level_n = [level / 100.0 * rating_n for level in LEVELS_PERCENT]
        drag |= {"level_n": level_n, "level_nm": [per_n * each for each in level_n]}
    (screw, table), whole = _inertias(machine), machine.model.inertia_kg_m2.value
    inertia = {"motor": whole - screw - table, "screw": screw, "table": table, "sum": whole}
    place_m = np.linspace(0.0, axis.stroke_m or plant.screw_length_m, PLACES).tolist()
    own, free, fixed = (
        [1.0 / axial_compliance(plant._replace(far_end_fixed=end), x, percent) for x in place_m]
        for end in (plant.far_end_fixed, 0.0, 1.0)
    )
    both = 1.0 / plant.motor_mass_kg + 1.0 / plant.table_mass_kg
    catalogue = plant.nut_catalogue_n_per_m
    unloaded = [loaded_nut_stiffness(0.0, level, catalogue, 1.0) for level in LEVELS_PERCENT]
    nut: dict[str, Any] = {"preload_percent": LEVELS_PERCENT, "unloaded_n_per_m": unloaded}
    if rating_n is not None:
        nut["load_n"] = np.linspace(0.0, 0.5 * rating_n, LOADS).tolist()
        nut |= {
            f"at_{level:g}_percent_n_per_m": [
                loaded_nut_stiffness(load_n, level, catalogue, rating_n) for load_n in nut["load_n"]
            ]
            for level in LEVELS_PERCENT
        }
    return {
        "drag": drag,
        "inertia_kg_m2": inertia,
        "stiffness": {
            "place_m": place_m,
            "own_n_per_m": own,
            "fixed_free_n_per_m": free,
            "fixed_fixed_n_per_m": fixed,
            "coupling_n_per_m": 1.0 / plant.further_compliance_m_per_n,
            "screw_at_far_end_n_per_m": plant.screw_rigidity_n / plant.screw_length_m,
            "bearing_n_per_m": 1.0 / plant.bearing_compliance_m_per_n,
        },
        "nut": nut,
        "frequency_hz": {
            "free": [math.sqrt(k * both) / (2.0 * math.pi) for k in own],
            "motor_held": [math.sqrt(k / plant.table_mass_kg) / (2.0 * math.pi) for k in own],
        },
        **{
            name: dynamics(each, rate_hz)
            for name, each in linear_models(plant, screw, own[PLACES // 2]).items()
        },
    }


def linear_models(
    plant: Plant, screw_kg_m2: float, stiffness_n_per_m: float
) -> dict[str, StateSpace]:
    """One, two and three masses at the motor, in rad and N m, and the component model.

    Of three masses the first is rotor and coupling, then the screw, then the table.
    """
    square, viscous = plant.ratio_m_per_rad**2, plant.motor_viscous_nm_s_per_rad
    motor, table = plant.motor_inertia_kg_m2, plant.table_mass_kg * square
    k, d = stiffness_n_per_m * square, plant.damping_n_s_per_m * square
    two = chain([motor, table], [(k, d)], [viscous, 0.0])
    models = {"one_mass": chain([motor + table], [], [viscous]), "two_mass": two}
    if motor > screw_kg_m2:
        springs = [(COUPLING_NM_PER_RAD, 0.0), (1.0 / (1.0 / k - 1.0 / COUPLING_NM_PER_RAD), d)]
        masses = [motor - screw_kg_m2, screw_kg_m2, table]
        models["three_mass"] = chain(masses, springs, [viscous, 0.0, 0.0])
    return models | {"component": component_model(two, plant.ratio_m_per_rad)}


def dynamics(system: StateSpace, rate_hz: float) -> dict[str, Any]:
    """State space; of the first input poles, zeros, z with the input held, responses.

    Poles and zeros are (real, imaginary); responses are those of each output, (n, outputs).
    """
    a, b, c = system.a, system.b[:, :1], system.c
    none, finite = np.zeros((len(c), 1)), np.diag([*np.ones(len(a)), 0.0])
    roots = {"poles_rad_s": np.linalg.eigvals(a)}
    for k, row in enumerate(c):  # of the whole system; ss2zpk loses them among those at infinity
        found = linalg.eigvals(np.block([[a, b], [row, np.zeros(1)]]), finite)
        roots[f"zeros_{k}_rad_s"] = found[np.abs(found) < _AT_INFINITY_RAD_S]
    parts = {name: np.column_stack([each.real, each.imag]) for name, each in roots.items()}
    held = signal.cont2discrete((a, b, c, none), 1.0 / rate_hz)[:4]
    values = {"a": a, "b": system.b, "c": c, **parts}
    values["z_numerator"], values["z_denominator"] = signal.ss2tf(*held)
    values["frequency_hz"] = np.geomspace(1.0, 0.5 * rate_hz, STEPS)
    s = 2j * np.pi * values["frequency_hz"][:, None, None]
    response = (c @ np.linalg.solve(s * np.eye(len(a)) - a, b[None]))[..., 0]
    values |= {"magnitude": np.abs(response), "phase_rad": np.unwrap(np.angle(response), axis=0)}
    values["step_s"] = np.arange(STEPS) / rate_hz
    values["step"] = signal.dlsim((*held, 1.0 / rate_hz), np.ones(STEPS))[1]
    return {"rate_hz": rate_hz} | {name: each.tolist() for name, each in values.items()}


def _export(path: Path, members: Mapping[str, Any]) -> None:
    if path.suffix not in (".mat", ".npz", ".csv"):
        raise ConfigError(f"--export {path}: expected a name that ends in .mat, .npz or .csv")
    with replaced_bytes(path) as file:
        if path.suffix == ".mat":
            io.savemat(file, dict(members), long_field_names=True)
        elif path.suffix == ".npz":
            np.savez(file, **members)
        else:
            for name, value in members.items():
                file.write(f"{name},{','.join(map(repr, np.ravel(value).tolist()))}\n".encode())


def _draw(path: Path, document: Mapping[str, dict[str, Any]]) -> None:
    """Frequency and step response of two masses, stiffness along the stroke and over the load."""
    if path.suffix != ".png":
        raise ConfigError(f"--plot {path}: expected a name that ends in .png")
    two, along, nut = document["two_mass"], document["stiffness"], document["nut"]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 6.4), layout="constrained")
        ((response, step), (stroke, load)) = figure.subplots(2, 2)
        response.loglog(two["frequency_hz"], two["magnitude"], label=("motor", "table"))
        response.set(xlabel="frequency, Hz", ylabel="angle over torque, rad/(N m)")
        step.plot(two["step_s"], two["step"], label=("motor", "table"))
        step.set(xlabel="time after a step of 1 N m, s", ylabel="angle, rad")
        for name in ("fixed_free", "fixed_fixed"):
            values = 1e-6 * np.array(along[f"{name}_n_per_m"])
            stroke.plot(along["place_m"], values, label=name.replace("_", "-"))
        stroke.set(xlabel="place along the stroke, m", ylabel="stiffness, N/µm")
        for level in LEVELS_PERCENT if "load_n" in nut else ():
            values = 1e-6 * np.array(nut[f"at_{level:g}_percent_n_per_m"])
            load.plot(nut["load_n"], values, label=f"{level:g} %")
        load.set(xlabel="load on the nut, N", ylabel="stiffness of the nut, N/µm")
        for axes in (response, step, stroke, load):
            axes.legend()
    write_png(figure, path)
