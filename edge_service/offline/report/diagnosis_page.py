"""The page of a diagnosis: plain words first, then numbers and pictures."""

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...diagnose.result import (
    ChannelGap,
    Diagnosis,
    NamedEffect,
    ParameterValue,
    Place,
    ReplayedSeries,
    Shrink,
    Verdict,
    WaterfallStep,
)
from ...diagnose.session.session import CHANNEL_WORDS, Session
from ...messages.interval import printed
from ...models.effects.registry import get_effect
from ...models.machine import Machine
from .page import ESTIMATE, MUTED, STYLE, TRUTH, as_svg, rendered
from .quantities import amount, interval, percent, words

SHOWN = {"torque_nm": ("torque gap, N m", 1.0), "transmission_m": ("position gap, µm", 1e6)}
LABELS = {  # label and factor of each variable for people
    "motor_speed_rad_s": ("motor speed, r/min", 30.0 / np.pi),
    "motor_acceleration_rad_s2": ("motor acceleration, rad/s²", 1.0),
    "table_position_m": ("table position, mm", 1e3),
    "direction": ("direction of motion", 1.0),
    "motor_angle_rad": ("angle within a turn, °", 180.0 / np.pi),
    "time_s": ("time, s", 1.0),
    "temperature_c": ("temperature, °C", 1.0),
}
_POINTS = 4000
_DPI = 130
_CLOCK_FROM_S = 1e9  # a clock that counts from 1970 passed it in 2001
_ROTARY_M_PER_RAD = 0.0573  # of an axis whose degrees are read as mm
_WINDOW_S = 4.0
_PAUSE_S = 0.05
_LEAST_STEP = 0.005  # of the whole gap: no more than a line's width


def draw_waterfall(channel: str, gap: ChannelGap, steps: Sequence[WaterfallStep]) -> str:
    """SVG: from the model as it is down to the floor."""
    label, factor = SHOWN[channel]
    names, levels = ["model as it is"], [gap.before]
    for step in steps:
        if abs(step.rms - levels[-1]) > _LEAST_STEP * gap.before:
            names.append(step.effect.replace("_", " "))
            levels.append(step.rms)
    figure = Figure(figsize=(7.6, 0.7 + 0.34 * len(names)), layout="constrained")
    axes = figure.subplots()
    axes.barh(range(len(names)), [factor * level for level in levels], color=ESTIMATE, height=0.6)
    axes.axvline(factor * gap.floor, color=TRUTH, linestyle=":", label="floor")
    axes.set_yticks(range(len(names)), [names[0], *(f"with {name}" for name in names[1:])])
    axes.invert_yaxis()
    axes.set_xlabel(f"{label} (root mean square)")
    return _svg(figure, axes, "waterfall")


def draw_replay(channel: str, gap: ReplayedSeries) -> str:
    """SVG: the seconds with most of the gap, measured and simulated."""
    label, factor = SHOWN[channel]
    energy = np.concatenate(([0.0], np.cumsum(gap.before**2)))
    ends = np.searchsorted(gap.time_s, gap.time_s + _WINDOW_S)
    start = int(np.argmax(energy[ends] - energy[:-1]))
    window = slice(start, int(ends[start]))
    time_s = gap.time_s[window]
    pauses = np.flatnonzero(np.diff(time_s) > _PAUSE_S) + 1
    figure = Figure(figsize=(7.6, 2.3), layout="constrained")
    axes = figure.subplots()
    simulated = gap.before - gap.after, ESTIMATE, "simulated with the named effects"
    for series, color, name in ((gap.before, MUTED, "measured"), simulated):
        shown = np.insert(factor * series[window], pauses, np.nan)
        axes.plot(np.insert(time_s, pauses, np.nan), shown, color=color, label=name)
    axes.set_xlabel(LABELS["time_s"][0])
    axes.set_ylabel(label)
    return _svg(figure, axes, "replay")


def draw_gap(channel: str, session: Session, found: Diagnosis) -> str:
    """SVG: the gap before and after over time and over where it lives."""
    rows, left = session.channels[channel], found.series.left[channel]
    best = next((p.variable for p in found.where if p.channel == channel), "motor_speed_rad_s")
    best = "motor_speed_rad_s" if best in ("time_s", "direction") else best
    label, factor = SHOWN[channel]
    pick = np.unique(np.linspace(0, len(left) - 1, _POINTS).astype(int))
    figure = Figure(figsize=(7.6, 2.9), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, variable in zip(panels, ("time_s", best), strict=True):
        x_label, x_factor = LABELS[variable]
        values = x_factor * rows.variables[variable][pick]
        look: Any = {"markersize": 1.6, "rasterized": True, "linestyle": "", "marker": "."}
        axes.plot(values, factor * rows.gap[pick], color=MUTED, label="before", **look)
        if found.verdict is not Verdict.UNKNOWN and found.effects:
            axes.plot(values, factor * left[pick], color=ESTIMATE, label="after", **look)
        axes.set_xlabel(x_label)
        axes.xaxis.set_major_locator(MaxNLocator(6))
    panels[0].set_ylabel(label)
    return _svg(figure, panels[0], "gap")


def _svg(figure: Figure, axes: Axes, salt: str) -> str:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, markerscale=5.0)
    return as_svg(figure, salt, _DPI)


def render(
    machine: Machine, names: Sequence[str], found: Diagnosis, session: Session | None = None
) -> str:
    """The page as HTML; nothing in it is loaded from elsewhere."""
    claimed = sorted({each.channel for each in found.effects})
    telling = [name for name, gap in found.gap.items() if name in claimed or gap.matters]
    telling = telling or sorted(found.gap)[: found.has_changed]
    shown = [name for name in claimed if found.gap[name].replayed]
    accepted = bool(found.effects) and found.verdict is not Verdict.UNKNOWN
    with mpl.rc_context(STYLE):
        waterfalls = {
            name: draw_waterfall(name, found.gap[name], found.waterfall.get(name, ()))
            for name in (telling if accepted else ())
        }
        led = {name: found.series.replayed[name] for name in (shown if accepted else ())}
        replays = {name: draw_replay(name, each) for name, each in led.items()}
        gaps = {name: draw_gap(name, session, found) for name in telling if session is not None}
    used = (percent, points, words, sure, amount, chance, quantity, places)
    filters = {"shown": interval, **{each.__name__: each for each in used}}
    return rendered(
        "diagnosis.html",
        filters,
        machine=machine,
        names=names,
        found=found,
        lead=verdict_sentence(found),
        quiet=[CHANNEL_WORDS[name] for name in found.gap if name not in telling],
        named=sorted(found.effects, key=_weight) if accepted else found.effects[:1],
        shown=shown,
        accepted=accepted,
        waterfalls=waterfalls,
        replays=replays,
        gaps=gaps,
        channels=CHANNEL_WORDS,
        describe=lambda name: get_effect(name).description,
    )


def verdict_sentence(found: Diagnosis) -> str:
    """Verdict in one sentence, the same in the report and on the terminal."""
    named = sorted(found.effects, key=_weight)
    used: Mapping[str, Callable[..., object]] = {"words": words, "lost": _lost}
    return rendered("verdict.txt", used, found=found, named=named, channels=CHANNEL_WORDS).strip()


def summary(found: Diagnosis, out: Path, m_per_rad: float) -> str:
    """Diagnosis on the terminal; its files are in `out`."""
    used = {each.__name__: each for each in (amount, chance, interval, places, points, quantity)}
    content = {"lead": verdict_sentence(found), "out": out, "channels": CHANNEL_WORDS}
    return rendered("summary.txt", used, found=found, m_per_rad=m_per_rad, **content).strip()


def _weight(each: NamedEffect) -> tuple[bool, float, float]:
    """A fault comes first, then the surest; of those as sure, what makes most of the difference."""
    is_fault = bool(each.entries) and get_effect(each.name).is_fault
    return not is_fault, -round(each.probability, 1), -each.shrink.estimate


def sure(probability: float) -> str:
    """Confidence in words that never say certain.

    >>> sure(0.9999), sure(0.75)
    ('more than 99 % sure', '75 % sure')
    """
    return "more than 99 % sure" if probability > 0.99 else f"{percent(probability)} sure"


def _lost(share: ParameterValue) -> str:
    """A loss in percent; what is not bounded lies between none and all."""
    value, low, high = printed(share.value, share.low or 0.0, share.high or 100.0)
    return f"{value} % lost, {low} to {high}"


def chance(p_value: float) -> str:
    """Chance in words, such as `0.041`, or `less than 0.0001`."""
    return f"{p_value:.2g}" if p_value >= 1e-4 else "less than 0.0001"


def quantity(effect: str, parameter: str) -> str:
    """Description of a parameter, as its effect gives it.

    >>> quantity("backlash", "width_m")
    'Clearance'
    """
    described = next(p for p in get_effect(effect).parameters if p.name == parameter)
    return described.description.rstrip(".")


def points(value: Shrink) -> str:
    """A shrink with its interval.

    >>> points(Shrink(estimate=0.802, low=0.67, high=0.904))
    '80 % (67 to 91)'
    """
    shrink, low, high = printed(100.0 * value.estimate, 100.0 * value.low, 100.0 * value.high)
    return f"{shrink} % ({low} to {high})"


def places(found: Sequence[Place], m_per_rad: float) -> list[str]:
    """Location of a gap, a sentence for each variable, as a controller shows it.

    >>> spans = [Place(channel="torque_nm", variable="motor_speed_rad_s", low=low, high=high,
    ...                unit="rad/s", share=0.71, energy=0.8)
    ...          for low, high in ((-5.0, 1.5), (20.0, 50.0))]
    >>> places(spans, 0.005)
    ['Torque: 71 % of the difference follows the table speed, -1500 to 450, 6000 to 15000 mm/min.']
    >>> places(spans[:1], 0.36 / 6.2832)
    ['Torque: 71 % of the difference follows the table speed, -17189 to 5157 °/min.']
    """
    spans: dict[tuple[str, str], list[Place]] = {}
    for each in found:
        spans.setdefault((each.channel, each.variable), []).append(each)
    return [
        f"{CHANNEL_WORDS[channel].capitalize()}: {percent(mine[0].share)} of the difference "
        f"follows the {_over(variable, mine, m_per_rad)}."
        for (channel, variable), mine in spans.items()
    ]


def located(found: Sequence[Place], m_per_rad: float) -> tuple[Place, ...]:
    """Places with their intervals as a controller shows them."""
    told = ({"machine_coordinate": _over(each.variable, [each], m_per_rad)} for each in found)
    return tuple(each.model_copy(update=x) for each, x in zip(found, told, strict=True))


def _over(variable: str, mine: Sequence[Place], m_per_rad: float) -> str:
    label, factor = {
        "motor_speed_rad_s": ("table speed, mm/min", 6e4 * m_per_rad),
        "motor_acceleration_rad_s2": ("table acceleration, m/s²", m_per_rad),
    }.get(variable, LABELS[variable])
    if round(m_per_rad, 4) == _ROTARY_M_PER_RAD:
        factor *= 1e3 if "m/s²" in label else 1.0
        label = label.replace("mm", "°").replace("m/s²", "°/s²")
    if variable == "time_s" and mine[0].low > _CLOCK_FROM_S:
        label = "time of day, UTC"
    name, _, unit = label.partition(", ")
    if variable == "direction":
        ways = {(0.0, 1.0): ", most of it forwards", (-1.0, 0.0): ", most of it backwards"}
        return name + ways.get((mine[0].low, mine[0].high), "")
    ends = (
        f"{_plain(factor * each.low, unit)} to {_plain(factor * each.high, unit)}"
        for each in sorted(mine, key=lambda place: place.low)
    )
    return f"{name}, {', '.join(ends)} {unit}"


def _plain(value: float, unit: str) -> str:
    if unit == "UTC":
        return f"{datetime.fromtimestamp(value, UTC):%H:%M:%S}"
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"
