"""The bench's arithmetic on made-up numbers; what it times is never asserted."""

import json
import mmap
import os
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_service.config import load_config
from edge_service.recordings.reader import read_trace

from ..identification.simulated_axis import write_recording
from ..table import Figure, PipelineBench, PipelineBenchError, number_text
from .bench import PipelineBenchSettings, run_pipeline_bench
from .live_load import write_config
from .process_meter import FinishedRun, ServiceProcess, cpu_s_of, memory_of, read_usage, stolen_s_of
from .replay_speed import estimate_count, running_speed
from .sample_delay import (
    PreloadPoller,
    Sighting,
    first_sightings,
    interval_delays_s,
    sample_delays_s,
    stamp_lateness_s,
    unix_ns,
)

MS = 1_000_000
needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc here")


def test_cpu_time_is_found_behind_a_name_with_brackets() -> None:
    fields_4_to_13 = "1 2 3 4 5 6 7 8 9 10"
    stat = f"4711 (odd) name (x) S {fields_4_to_13} 250 130 77 88 20 0 5 0 1234"
    assert cpu_s_of(stat, 100) == pytest.approx(3.8)


def test_stolen_time_is_that_of_all_processors() -> None:
    stat = "cpu  100 20 30 4000 50 6 7 890 0 0\ncpu0 50 10 15 2000 25 3 3 445 0 0\n"
    assert stolen_s_of(stat, 100) == pytest.approx(8.9)


def test_memory_is_read_in_bytes() -> None:
    status = (
        "Name:\tpython\nVmPeak:\t  9000 kB\nVmHWM:\t  2000 kB\nVmRSS:\t  1500 kB\nThreads:\t3\n"
    )
    assert memory_of(status) == (1500 * 1024, 2000 * 1024)


def test_an_ended_process_has_no_memory() -> None:
    with pytest.raises(PipelineBenchError, match="ended before its time"):
        memory_of("Name:\tpython\nState:\tZ (zombie)\n")


@needs_proc
def test_usage_agrees_with_the_process_own_clock() -> None:
    before, own_before_s = read_usage(os.getpid()), time.process_time()
    while time.process_time() - own_before_s < 0.1:
        pass
    ballast = mmap.mmap(-1, 50_000_000)  # never memory that was freed before
    for page in range(0, len(ballast), mmap.PAGESIZE):
        ballast[page] = 1
    after, own_after_s = read_usage(os.getpid()), time.process_time()
    tick_s = 1.0 / os.sysconf("SC_CLK_TCK")
    assert after.cpu_s - before.cpu_s == pytest.approx(own_after_s - own_before_s, abs=3 * tick_s)
    assert after.rss_bytes - before.rss_bytes > 0.9 * len(ballast)
    assert after.peak_rss_bytes >= after.rss_bytes


def test_only_the_first_sighting_of_an_interval_counts() -> None:
    seen = [(None, 0), (100, 130), (100, 135), (200, 220), (200, 225), (300, 321)]
    sightings = [Sighting("estimated", measured, at) for measured, at in seen]
    assert first_sightings(sightings) == [(200, 220), (300, 321)]


def test_nothing_seen_gives_nothing() -> None:
    assert first_sightings([Sighting("unestimated", None, 5)]) == []


def test_an_interval_that_was_skipped_waited_one_interval_longer() -> None:
    firsts = [(1000 * MS, 1030 * MS), (1300 * MS, 1320 * MS), (1400 * MS, 1440 * MS)]
    delays_s = interval_delays_s(firsts, 0.1)
    assert sorted(delays_s) == pytest.approx([0.02, 0.03, 0.04, 0.12, 0.22])


@given(
    delay_s=st.floats(0.0, 1.0),
    percent=st.floats(0.0, 100.0),
    intervals=st.integers(1, 5),
)
def test_samples_spread_evenly_over_their_interval(
    delay_s: float, percent: float, intervals: int
) -> None:
    delays_s = sample_delays_s(np.full(intervals, delay_s), 0.1, 0.001)
    assert delays_s.size == 100 * intervals
    exact_s = delay_s + 0.0005 + 0.1 * percent / 100.0  # quantile of the uniform distribution
    assert np.percentile(delays_s, percent) == pytest.approx(exact_s, abs=0.0006)


@given(
    start_ms=st.integers(0, 10**12),
    late_ms=st.lists(st.integers(0, 4), min_size=20, max_size=40),
    stall_ms=st.integers(0, 70),
)
def test_lateness_of_stamps_is_against_the_typical_one(
    start_ms: int, late_ms: list[int], stall_ms: int
) -> None:
    late_ms = [*late_ms, stall_ms]
    firsts = [((start_ms + 100 * k + late) * MS, 0) for k, late in enumerate(late_ms)]
    lateness_s = stamp_lateness_s(firsts, 0.1)
    assert np.diff(lateness_s) == pytest.approx(1e-3 * np.diff(late_ms), abs=1e-9)
    assert abs(np.median(lateness_s)) < 0.005


def test_moment_of_an_answer() -> None:
    assert unix_ns("1970-01-01T00:00:01.234Z") == 1234 * MS


def test_start_up_cancels_out_of_the_replay_speed() -> None:
    start_up_s, speed = 1.7, 80.0
    short = FinishedRun(0.0, start_up_s + 5.0 / speed, "")
    long = FinishedRun(0.0, start_up_s + 300.0 / speed, "")
    assert running_speed(short, long, 295.0) == pytest.approx(speed)


def test_a_longer_recording_that_costs_nothing_is_no_measurement() -> None:
    assert running_speed(FinishedRun(1.0, 2.0, ""), FinishedRun(1.0, 2.0, ""), 295.0) is None


@pytest.mark.parametrize(
    "output",
    [
        "axis X7: 2999 estimates, status estimated at 299.9 s\npreload 7.14 % (6.55 to 7.14)",
        "e5.csv: 2999 blocks, last status estimated",
    ],
)
def test_count_of_estimates(output: str) -> None:
    assert estimate_count(output) == 2999


def test_output_without_a_count_is_reported() -> None:
    with pytest.raises(PipelineBenchError, match="gave no interval"):
        estimate_count("axis X: the recording gave no interval")


BENCH = PipelineBench(
    (
        Figure("cpu", "processor", 0.42, "cores", 0.5),
        Figure("delay_s", "a delay with a long name", 0.2, "s", 0.15),
        Figure("steps_per_s", "steps", 1234567.0, "steps/s"),
    ),
    ("a note",),
)


def test_an_aim_is_met_or_not_or_absent() -> None:
    assert [figure.met for figure in BENCH.figures] == [True, False, None]
    assert Figure("x", "at the aim", 0.5, "s", 0.5).met is True


def test_the_table_is_aligned() -> None:
    lines = BENCH.as_text().splitlines()
    end_of_value = lines[0].index("value") + len("value")
    for line, value in zip(lines[1:4], ("0.42", "0.2", "1,234,567"), strict=True):
        assert line[:end_of_value].endswith("  " + value)
    assert [line.endswith(("yes", "NO")) for line in lines[1:4]] == [True, True, False]
    assert lines[-1] == "a note"


def test_json_holds_every_figure() -> None:
    content = json.loads(json.dumps(BENCH.as_dict(), allow_nan=False))
    assert {figure["key"]: figure["value"] for figure in content["figures"]} == {
        "cpu": 0.42,
        "delay_s": 0.2,
        "steps_per_s": 1234567.0,
    }
    assert [figure["met"] for figure in content["figures"]] == [True, False, None]


@pytest.mark.parametrize(
    ("value", "text"), [(0.012345, "0.0123"), (99.94, "99.9"), (99.97, "100"), (1234.5, "1,234")]
)
def test_numbers_have_three_digits_or_all(value: float, text: str) -> None:
    assert number_text(value) == text


def test_configuration_has_as_many_different_axes_as_asked(tmp_path: Path) -> None:
    write_config(tmp_path / "edge.toml", 8)
    config = load_config(tmp_path / "edge.toml")
    assert [axis.name for axis in config.axes] == [f"A{k}" for k in range(1, 9)]
    assert len({axis.settings["seed"] for axis in config.axes}) == 8
    assert {axis.settings["scenario"] for axis in config.axes} == {"healthy"}
    assert config.http.port == 0


def test_recording_has_a_row_per_period(tmp_path: Path) -> None:
    write_recording(tmp_path / "trace.csv", 2.0)
    frame = read_trace(tmp_path / "trace.csv")
    assert frame.time_s == pytest.approx(np.arange(2000) / 1000.0)


def test_a_failed_process_is_reported_in_one_line(tmp_path: Path) -> None:
    arguments = ["check-config", str(tmp_path / "missing.toml")]
    with (
        ServiceProcess(arguments, tmp_path, tmp_path) as process,
        pytest.raises(PipelineBenchError) as caught,
    ):
        process.wait_for_end(60.0)
    assert str(caught.value).startswith("edge-service check-config ended with exit status 2: ")
    assert "missing.toml: no such file" in str(caught.value)
    assert "\n" not in str(caught.value)


@needs_proc
def test_a_process_ends_with_an_interrupted_bench(tmp_path: Path) -> None:
    write_config(tmp_path / "edge.toml", 1)
    with (
        pytest.raises(KeyboardInterrupt),
        ServiceProcess(["run", str(tmp_path / "edge.toml")], tmp_path, tmp_path) as process,
    ):
        process.usage()
        raise KeyboardInterrupt
    with pytest.raises(PipelineBenchError):
        process.usage()
    process.stop()


@contextmanager
def _answering(
    body: dict[str, object], connections: list[object], *, answers_per_connection: int = 1000
) -> Iterator[tuple[str, int]]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        answers = 0

        def setup(self) -> None:
            connections.append(self.client_address)
            super().setup()

        def do_GET(self) -> None:
            content = json.dumps(body | {"path": self.path}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)
            self.answers += 1
            self.close_connection = self.answers == answers_per_connection

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield "127.0.0.1", server.server_port
        finally:
            server.shutdown()
            thread.join()


def test_the_poller_asks_over_one_connection() -> None:
    connections: list[object] = []
    body: dict[str, object] = {"status": "estimated", "measured_at": "1970-01-01T00:00:02.500Z"}
    before_ns = time.time_ns()
    with _answering(body, connections) as address, closing(PreloadPoller(*address, "A1")) as poller:
        answers = [poller.ask() for _ in range(3)]
    assert [(answer.status, answer.measured_ns) for answer in answers] == [
        ("estimated", 2500 * MS)
    ] * 3
    assert before_ns <= answers[0].seen_ns <= answers[-1].seen_ns <= time.time_ns()
    assert len(connections) == 1


def test_the_poller_survives_a_connection_that_the_server_ends() -> None:
    connections: list[object] = []
    body: dict[str, object] = {"status": "unestimated", "measured_at": None}
    with (
        _answering(body, connections, answers_per_connection=2) as address,
        closing(PreloadPoller(*address, "A1")) as poller,
    ):
        assert [poller.ask().status for _ in range(5)] == ["unestimated"] * 5
    assert len(connections) == 3


def test_an_answer_without_a_preload_is_reported() -> None:
    with (
        _answering({"status": 404, "title": "Not Found"}, []) as address,
        closing(PreloadPoller(*address, "B7")) as poller,
        pytest.raises(PipelineBenchError, match="GET /api/v1/axes/B7/preload: no preload"),
    ):
        poller.ask()


@pytest.mark.slow
@needs_proc
def test_the_quick_bench_gives_every_figure() -> None:
    lines: list[str] = []
    bench = run_pipeline_bench(PipelineBenchSettings(quick=True), lines.append)
    keys = [figure.key for figure in bench.figures]
    assert len(set(keys)) == len(keys)
    assert {f"start_{kind}_page_s" for kind in ("cold_1", "warm_1", "warm_8")} <= set(keys)
    for axes in (1, 8):
        stems = (f"cpu_{axes}", f"peak_rss_{axes}_mb", f"delay_{axes}_p99_s")
        assert set(stems) <= set(keys)
    assert {"replay_speed", "estimate_speed", "bank_filterpy_per_s", "cpu_simulation"} <= set(keys)
    assert {"plant_plain_s", "plant_effects_s"} <= set(keys)
    may_be_zero = {"replay_lost_intervals", "delay_1_stamp_p99_s", "delay_8_stamp_p99_s"}
    assert all(figure.value > 0.0 for figure in bench.figures if figure.key not in may_be_zero)
    assert bench.value("replay_lost_intervals") == 0.0
    assert lines
    assert {f.key for f in bench.figures if f.at_most is not None} >= {
        "cpu_8",
        "peak_rss_8_mb",
        "delay_8_p99_s",
    }
