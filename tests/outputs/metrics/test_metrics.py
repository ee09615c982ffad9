"""Metrics as Prometheus' own tool takes them: names, units, and no sample without a number."""

import shutil
import subprocess
from dataclasses import replace

import pytest
from prometheus_client.parser import text_string_to_metric_families

from edge_service.messages.health import ComponentHealth, ComponentStatus
from edge_service.messages.interval import Interval
from edge_service.messages.trend import Trend, TrendStatus
from edge_service.outputs.base import OutputConfig, OutputContext
from edge_service.outputs.metrics import MetricsOutput, family_names

from ...messages.answers import SILENT, answer, health_of

PROMTOOL = shutil.which("promtool")


def text_of(*answers: object, **facts: object) -> str:
    output = MetricsOutput(OutputConfig(), OutputContext("metrics", "hall", "mill"))
    return output.text("37ef", True, answers, **facts).decode()  # type: ignore[arg-type]


def full() -> str:
    trend = Trend(
        status=TrendStatus.FALLING,
        reason="r",
        since_time_ns=1,
        rate_fresh_percent_per_h=Interval(value=-3.6, low=-7.2, high=0.0),
    )
    report = ComponentHealth(component="mqtt", status=ComponentStatus.OK)
    return text_of(
        answer(preload_percent=6.85, health=health_of("WARNING", trend=trend)),  # type: ignore[arg-type]
        replace(SILENT, axis="Y"),
        components=(report,),
        temperature_c={"X": 31.5},
        dropped={("raw", "gap"): 3},
        outboxes={"mqtt": (2, 1, 1_000_000_000)},
    )


def samples(text: str) -> dict[tuple[str, ...], float]:
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_numbers_stand_in_base_units_with_their_bounds() -> None:
    told = samples(full())
    assert told["edge_service_preload_fresh_ratio", "X", "value"] == pytest.approx(1.0)
    assert told["edge_service_preload_rating_ratio", "X", "low"] == pytest.approx(0.065)
    rate = told["edge_service_preload_fresh_ratio_per_second", "X", "low"]
    assert rate == pytest.approx(-2e-5)
    assert told["edge_service_condition", "X", "WARNING"] == 1.0
    assert told["edge_service_temperature_celsius", "X"] == 31.5
    assert told["edge_service_payloads_dropped_total", "gap", "raw"] == 3.0
    assert told["edge_service_outbox_messages", "mqtt", "dead"] == 1.0
    assert told["edge_service_outbox_oldest_timestamp_seconds", "mqtt"] == 1.0


def test_a_number_that_does_not_exist_has_no_sample() -> None:
    told = samples(text_of(SILENT))
    assert not any(name[0].startswith("edge_service_preload") for name in told)
    assert told["edge_service_condition", "X", "UNAVAILABLE"] == 1.0


def test_every_family_has_another_name() -> None:
    names = family_names()
    assert len(set(names)) == len(names) == 25


@pytest.mark.skipif(PROMTOOL is None, reason="promtool is not installed (Debian: prometheus)")
def test_promtool_has_nothing_to_say() -> None:
    done = subprocess.run(
        [str(PROMTOOL), "check", "metrics"],
        input=full(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
