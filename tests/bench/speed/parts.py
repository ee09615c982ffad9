"""Parts of the service by themselves, each beside what does the same without it."""

import sqlite3
import statistics
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.integrate import solve_ivp

from edge_service.config import DEFAULT_MACHINE, EstimatorConfig, load_machine
from edge_service.estimate.imm.bank import CompiledBank, FilterpyBank, run_bank
from edge_service.health.store.history import CHUNKS_S, HOUR_S, History, put_chunk
from edge_service.health.store.rows import QUANTITIES, ROW, STATUSES, aggregate, between
from edge_service.health.store.store import Store
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.samples import CHANNELS, Floats, SampleFrame
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits
from edge_service.nodes.stages import make_estimator
from edge_service.offline.reproduce.simulation import ThesisCase, bank_inputs, run_case
from edge_service.recordings.reader import read_trace
from edge_service.recordings.writer import TraceWriter

from ..estimator.axis import downsampled
from .peer import bank

IVP_S, AXIS_TIME_S, RATE_HZ = 2.0, 100.0, 1000.0
SINGLE_STEPS, FILTERPY_STEPS = 500, 100
TYPICAL_EFFECTS = (
    "stribeck",
    "torque_ripple",
    "position_friction",
    "lead_error",
    "backlash",
    "warmup",
    "load_offset",
    "encoder_eccentricity",
)
YEAR_S, BUCKETS = 365.0 * 86_400.0, 1000
_BEGIN_S = 1_767_225_600.0  # 2026 in UTC, which is one file of hours
FRAME_ROWS = 100


def processor_us(work: Callable[[], object], count: int, repeats: int) -> float:
    """Median processor time of one of `count` things that `work` does, after a first run, us."""
    work()
    spent = []
    for _ in range(repeats):
        begun_s = time.process_time()
        work()
        spent.append(time.process_time() - begun_s)
    return 1e6 * statistics.median(spent) / count


def estimator_us(recording: Path, repeats: int) -> tuple[float, float]:
    """An interval through the mixture estimator, and through filterpy's five modes, us."""
    machine = load_machine(DEFAULT_MACHINE)
    blocks = downsampled([read_trace(recording)], machine)
    peer = bank()

    def ours() -> None:
        estimator = make_estimator(EstimatorConfig(), machine)
        for block in blocks:
            estimator.update(block)
            estimator.estimate()

    def theirs() -> None:
        for block in blocks:
            peer.predict()
            peer.update(np.array([block.torque_mean_nm, block.speed_end_rad_s]))

    count = len(blocks)
    return processor_us(ours, count, repeats), processor_us(theirs, count, repeats)


def ivp_s(repeats: int) -> float:
    """Processor time of 100 s of two masses, friction and a controller by `solve_ivp`, s."""
    inertia, table, spring, damping = 1.5e-3, 1e-4, 200.0, 0.05

    def change(t: float, state: Floats) -> list[float]:
        angle, speed, far, far_speed = state
        wish = 5.0 * (20.0 * np.sin(3.0 * t) - angle)
        twist = spring * (angle - far) + damping * (speed - far_speed)
        friction = 0.146 * np.tanh(speed / 0.1) + 5e-3 * speed
        return [
            speed,
            (0.5 * (wish - speed) - friction - twist) / inertia,
            far_speed,
            twist / table,
        ]

    def work() -> None:
        solve_ivp(change, (0.0, IVP_S), np.zeros(4), method="LSODA", max_step=1e-3)

    return processor_us(work, 1, repeats) / 1e6 / IVP_S * AXIS_TIME_S


def bank_us(repeats: int) -> tuple[float, float, float]:
    """A step of five modes: compiled over a run, sample by sample, and by filterpy, us."""
    run, _ = run_case(ThesisCase(1, step_s=1e-3), seed=0)
    step, drives, start = bank_inputs(ThesisCase(1, step_s=1e-3), run)
    measurements = run.measurement

    def one_by_one(bank: CompiledBank | FilterpyBank, steps: int) -> float:
        inputs = [(replace(step, drive=drives[k]), measurements[k]) for k in range(steps)]

        def work() -> None:
            bank.reset(start)
            for each, measurement in inputs:
                bank.step(each, measurement)

        return processor_us(work, steps, repeats)

    batch = lambda: run_bank(step, drives, measurements, start)  # noqa: E731
    return (
        processor_us(batch, len(drives), repeats),
        one_by_one(CompiledBank(), SINGLE_STEPS),
        one_by_one(FilterpyBank(), FILTERPY_STEPS),
    )


def plant_s(effects: bool, repeats: int) -> float:
    """Processor time of 100 s of the simulated plant, without effects or with eight, s."""
    machine = load_machine(DEFAULT_MACHINE)
    limits = motion_limits(machine)
    active = [parse_effect(effect) for effect in (TYPICAL_EFFECTS if effects else ())]
    settings = FeedDriveSettings.of_machine(machine, RATE_HZ, active)
    segments = MOTIONS["production"](limits, np.random.default_rng(1))
    setpoints = Setpoints(segments, limits.low_m, RATE_HZ).take(round(AXIS_TIME_S * RATE_HZ))
    preload = np.full(len(setpoints), machine.fresh_preload_percent or 0.0)

    def work() -> None:
        FeedDrive(settings, limits.low_m, float(preload[0]), 1).advance(setpoints, preload)

    return processor_us(work, 1, repeats) / 1e6


def recorder_us(rows: int, repeats: int) -> tuple[float, float]:
    """A sample written in frames of 100 ms, as they are published, and in one go by numpy, us."""
    values = np.random.default_rng(1).standard_normal(rows)
    time_s = np.arange(rows) / 1000.0
    frames = [
        SampleFrame(time_s[k : k + FRAME_ROWS], dict.fromkeys(CHANNELS, values[k : k + FRAME_ROWS]))
        for k in range(0, rows, FRAME_ROWS)
    ]
    with tempfile.TemporaryDirectory() as folder:

        def ours() -> None:
            with TraceWriter(Path(folder) / "ours.parquet", tuple(CHANNELS)) as writer:
                for frame in frames:
                    writer.write(frame)

        def theirs() -> None:
            np.save(Path(folder) / "theirs.npy", np.array([time_s, *[values] * len(CHANNELS)]))

        return processor_us(ours, rows, repeats), processor_us(theirs, rows, repeats)


def history_us(repeats: int) -> tuple[float, float]:
    """A year of estimates read from the disk in 1000 buckets, and the bare file by Arrow, us.

    The year holds an estimate in ten minutes; a service keeps as many rows of hours whatever came.
    """
    time_s = np.arange(_BEGIN_S, _BEGIN_S + YEAR_S, 600.0)
    values = np.random.default_rng(1).uniform(4.0, 6.0, (len(QUANTITIES), time_s.size))
    rows = np.zeros(time_s.size, ROW)
    rows["time_us"], rows["status"] = time_s * 1e6, STATUSES.index(EstimateStatus.ESTIMATED)
    rows["bounds"] = np.stack([values[0] - 1.0, values[0] + 1.0], axis=1)
    rows["values"], rows["samples"], rows["count"] = values.T[:, np.newaxis], 1, 1
    with tempfile.TemporaryDirectory() as folder:
        path, file = Path(folder) / "edge-service.sqlite", Path(folder) / "bare.parquet"
        hours = aggregate(rows, 3600.0, _BEGIN_S)
        means = hours["values"][:, 1].T
        pq.write_table(pa.table({str(n): each for n, each in enumerate(means)}), file)
        store = Store(path)
        History(store)

        def fill(connection: sqlite3.Connection) -> None:
            length_s = CHUNKS_S[HOUR_S]
            first_s = int(_BEGIN_S // length_s) * length_s
            for start_s in range(first_s, int(_BEGIN_S + YEAR_S), length_s):
                part = between(hours, start_s, start_s + length_s)
                put_chunk(connection, "X", HOUR_S, start_s, part)

        store.write(fill)
        store.close()

        def ours() -> None:
            with closing(Store(path)) as fresh:  # one that has read nothing yet
                read = History(fresh).buckets("X", _BEGIN_S, _BEGIN_S + YEAR_S, YEAR_S / BUCKETS)
            assert len(read) == BUCKETS

        def theirs() -> None:
            assert pq.read_table(file).num_rows == YEAR_S / 3600.0

        return processor_us(ours, 1, repeats), processor_us(theirs, 1, repeats)
