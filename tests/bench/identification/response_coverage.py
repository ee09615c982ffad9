"""Intervals of `edge-service fingerprint`: how often they hold the truth of drawn two-mass axes.

python -m tests.bench.identification.response_coverage --axes 120
"""

import math
from collections.abc import Mapping

import click
import numpy as np

from edge_service.fingerprint.response.control_response import (
    measure_control_response,
    relative_error,
)
from edge_service.fingerprint.response.frequency_response import FrequencyResponse

from ..table import Figure, PipelineBench

LEAST_HELD = 0.88
_FREQUENCIES, _AVERAGES, _DELAY_S = 300, 20.0, 1e-4


def drawn_axis(seed: int) -> tuple[FrequencyResponse, dict[str, float]]:
    """A noisy response with its coherence, and the truth by the names of the figures."""
    draw = np.random.default_rng(seed)
    notch, ratio = 2.0 * math.pi * draw.uniform(20.0, 150.0), draw.uniform(1.1, 1.6)
    damping, inertia = draw.uniform(0.02, 0.06), 10.0 ** draw.uniform(-3.0, -1.0)
    noise = 10.0 ** draw.uniform(-2.5, -1.0)
    frequency = np.geomspace(2.0, 1000.0, _FREQUENCIES)
    s, peak = 2j * math.pi * frequency, notch * ratio
    above = (s / notch) ** 2 + 2.0 * damping * s / notch + 1.0
    below = (s / peak) ** 2 + 2.0 * damping * ratio * s / peak + 1.0
    exact = above / below / (inertia * s) * np.exp(-s * _DELAY_S)
    errors = draw.normal(size=_FREQUENCIES) + 1j * draw.normal(size=_FREQUENCIES)
    coherence = np.full(_FREQUENCIES, 1.0 / (1.0 + 2.0 * _AVERAGES * noise**2))
    error = relative_error(coherence, _AVERAGES)
    response = exact * (1.0 + noise * errors)
    share = 1.0 - ratio**-2
    stiffness = inertia * share * notch**2
    truth = {
        "antiresonance_hz": notch / (2.0 * math.pi),
        "resonance_hz": peak / (2.0 * math.pi),
        "resonance_damping": damping * ratio,
        "table_share": share,
        "response_inertia_kg_m2": inertia,
        "motor_inertia_kg_m2": inertia * (1.0 - share),
        "load_inertia_kg_m2": inertia * share,
        "stiffness_nm_per_rad": stiffness,
        "damping_nm_s_per_rad": 2.0 * damping * stiffness / notch,
        "torque_delay_s": _DELAY_S,
    }
    return (
        FrequencyResponse(
            frequency, response, error, coherence, _AVERAGES, "rad/(s N m)", 0.0, False, 0.0
        ),
        truth,
    )


def held(seed: int) -> Mapping[str, bool]:
    """Intervals of a drawn axis that hold their truth, or not; empty where no mode is told."""
    measured, truth = drawn_axis(seed)
    try:
        figures, _ = measure_control_response(measured, speed_over_torque=True)
    except ValueError:
        return {}
    if not math.isfinite(figures["antiresonance_hz"].value):
        return {}
    return {name: figures[name].holds(true) for name, true in truth.items()}


def coverage(axes: int) -> PipelineBench:
    """Share of the axes whose intervals hold the truth, figure by figure."""
    answers = [answer for answer in map(held, range(axes)) if answer]
    shares = {name: float(np.mean([each[name] for each in answers])) for name in answers[0]}
    rows = (
        Figure(name, f"{name} within its 95 % interval", share, "", at_least=LEAST_HELD)
        for name, share in shares.items()
    )
    told = Figure("told", "axes whose mode is told", float(len(answers)), "")
    return PipelineBench((told, *rows), (f"of {axes} axes",))


@click.command()
@click.option("--axes", type=click.IntRange(1), default=120, show_default=True)
def main(axes: int) -> None:
    """Print how often the intervals of a control's response hold the truth."""
    click.echo(coverage(axes).as_text())


if __name__ == "__main__":
    main()
