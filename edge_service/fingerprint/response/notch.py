"""Antiresonance of the table from a test by shaking on a slow feed, or the reason against it.

Torque over acceleration has a notch where the table swings against the motor, f_a =
sqrt(K / M) / 2 pi: grease, warmth and torque constant do not move it, the nut's stiffness does.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import ndimage

from ...messages.samples import ANGLE, SETPOINT, TORQUE, Floats, SampleFrame
from ...models.commissioned import Notch
from ...process import end_with_parent
from ...recordings.conditioning import UniformRun, uniform_runs
from ...recordings.reader import handed
from .control_response import modes_of
from .frequency_response import FrequencyResponse, drive_response, sampling_correction
from .two_mass_fit import LOWEST_HZ, TwoMassFit, fit_two_mass, modes, shakes

LEAST_S = 5.0
ROUGH = 0.1
"""Vibration over feed, upper quartile: no cut or cruise is as rough."""
_SMOOTH_S, _TURNED_BACK, _STEADY = 0.008, 0.01, 0.25
NEAR, BESIDE = 1.3, 1.5
"""Factors on the antiresonance, within which coherence is asked for, and a second mode refused."""
LEAST_COHERENCE, MOST_MISFIT, MOST_ERROR, MOST_SHARE = 0.4, 0.1, 0.05, 1.0 / 3.0
"""Around the antiresonance; of the response's logarithm; of f_a; f_a over the sampling rate."""
_SURE = 0.8
"""Coherence in which another mode is believed."""


def notch_of(recording: SampleFrame) -> Notch | None:
    """Notch that a recording shows; None of one that is no test: nothing shakes the axis.

    Raises ValueError: it is a test that cannot be used; the text says why.
    """
    runs = [*uniform_runs(recording, (TORQUE, ANGLE), optional=(SETPOINT,))]
    ways = [way for run in runs for way in _ways(run)]
    if not ways:
        if any(_stands(run) for run in runs) and shakes(recording):
            raise ValueError(_TURNS)
        return None
    if any(np.mean(np.sign(feed) * _speed(run) <= 0.0) > _TURNED_BACK for run, feed in ways):
        raise ValueError(_TURNS)
    measured = _as_sampled(drive_response([SampleFrame(r.time_s, r.channels) for r, _ in ways]))
    fit = fit_two_mass(measured.within(LOWEST_HZ, math.inf), correlated=True)
    figures = modes(fit)
    found, share = figures["antiresonance_hz"], figures["table_share"]
    if not (found.determined and share.determined):
        raise ValueError(f"no antiresonance: {found.note or 'the fit is not determined'}")
    notch_hz = found.value
    if notch_hz * ways[0][0].period_s > MOST_SHARE:
        raise ValueError(
            f"an antiresonance of {notch_hz:.4g} Hz needs {3.0 * notch_hz:.0f} samples/s"
        )
    _check(measured, fit, notch_hz)
    if found.sigma > MOST_ERROR * notch_hz:
        raise ValueError(f"the antiresonance of {notch_hz:.4g} Hz is known to {found.sigma:.2g} Hz")
    level_nm = {feed > 0.0: float(np.mean(run.channels[TORQUE])) for run, feed in ways}
    ratio, damping = share.value / (1.0 - share.value), figures["resonance_damping"].value
    return Notch(
        antiresonance_hz=notch_hz,
        antiresonance_sigma_hz=found.sigma,
        damping_ratio=damping * math.sqrt(1.0 - share.value),
        inertia_ratio=ratio,
        inertia_ratio_sigma=share.sigma / (1.0 - share.value) ** 2,
        place_rad=float(np.mean([np.mean(run.channels[ANGLE]) for run, _ in ways])),
        feed_rad_s=float(np.mean([abs(feed) for _, feed in ways])),
        friction_nm=0.5 * (level_nm[True] - level_nm[False]) if len(level_nm) > 1 else None,
    )


_TURNS = (
    "the axis reversed or stood while it was shaken; the feed must be faster than the vibration"
)


def _ways(run: UniformRun) -> list[tuple[UniformRun, float]]:
    """Parts of a run at one feed that are shaken for long enough, with their feed, rad/s."""
    step = max(round(0.5 / LOWEST_HZ / run.period_s), 1)
    angle = run.channels[ANGLE][::step]  # means of the speed over whole periods of the slowest wave
    feed = (angle[2:] - angle[:-2]) / (2.0 * step * run.period_s)
    usual = ndimage.median_filter(feed, 21)
    found = []
    for sign in (1.0, -1.0):
        steady = np.abs(feed - usual) < _STEADY * sign * usual
        for (rows,) in ndimage.find_objects(ndimage.label(steady)[0]):
            where = slice((rows.start + 1) * step, (rows.stop + 1) * step)
            channels = {name: each[where] for name, each in run.channels.items()}
            part = UniformRun(run.start_s + where.start * run.period_s, run.period_s, channels)
            speed = _speed(part)
            middle = float(np.median(speed))
            rough = np.quantile(np.abs(speed - middle), 0.75) > ROUGH * abs(middle)
            if len(part) * part.period_s >= LEAST_S and rough:
                found.append((part, middle))
    return found


def _stands(run: UniformRun) -> bool:
    """Mostly no feed under what vibration there is."""
    speed = _speed(run)
    feed = ndimage.uniform_filter1d(speed, max(round(1.0 / LOWEST_HZ / run.period_s), 1))
    return bool(np.median(np.abs(feed)) < np.median(np.abs(speed - feed)))


def _speed(run: UniformRun) -> Floats:
    """Speed of the motor without the steps of its encoder, rad/s."""
    width = max(round(_SMOOTH_S / run.period_s), 1)
    angle = run.channels[ANGLE]
    return np.asarray(angle[width:] - angle[:-width]) / (width * run.period_s)


def _as_sampled(measured: FrequencyResponse) -> FrequencyResponse:
    """Response to a torque that goes on between its samples: a drive's loop is faster than they."""
    s, period_s = 2j * math.pi * measured.frequency_hz, measured.period_s
    differences = (1.0 - np.exp(-s * period_s)) / (s * period_s)
    held = sampling_correction(measured.frequency_hz, period_s) * differences
    return replace(measured, response=measured.response / held, period_s=0.0)


def _check(measured: FrequencyResponse, fit: TwoMassFit, notch_hz: float) -> None:
    near = measured.within(notch_hz / NEAR, notch_hz * NEAR)
    coherence = float(np.sum(near.coherence)) / (notch_hz * (NEAR - 1.0 / NEAR))
    if coherence < LEAST_COHERENCE:
        raise ValueError(
            f"coherence of {coherence:.2f} around the antiresonance, expected {LEAST_COHERENCE:g}"
        )
    misfits = np.log(np.abs(fit.response(near.frequency_hz) / near.response))
    misfit = float(np.median(np.abs(misfits - np.median(misfits))))  # a torque constant may be off
    if misfit > MOST_MISFIT:
        raise ValueError(
            f"two masses miss the response by {misfit:.0%}, expected {MOST_MISFIT:.0%}"
        )
    others = [mode.antiresonance_hz for mode in modes_of(measured.coherent(_SURE))]
    for other_hz in sorted(others, key=lambda hz: abs(math.log(hz / notch_hz)))[1:]:
        if abs(math.log(other_hz / notch_hz)) < math.log(BESIDE):
            raise ValueError(f"a second mode at {other_hz:.4g} Hz beside {notch_hz:.4g} Hz")


if __name__ == "__main__":
    end_with_parent()
    found = notch_of(handed(Path(sys.argv[1])))
    sys.stdout.write("" if found is None else found.model_dump_json())
