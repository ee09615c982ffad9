"""A row of the plant and a row of the HTTP fleet say the same of the same axis."""

import json
from datetime import datetime
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.health.advice.consistent import consistent
from edge_service.health.axis_report import MOST_LETTERS, axis_report
from edge_service.health.fleet.rows import FleetRow
from edge_service.health.service_state import ServiceState
from edge_service.health.settings import AxisLimits
from edge_service.http_api.compose import axes_answer, preload_answer, service_answer
from edge_service.messages.alarm import Alarm, AlarmKind
from edge_service.messages.answer import AxisAnswer
from edge_service.messages.estimate import EstimateStatus, Interval, PreloadEstimate
from edge_service.messages.event import Severity
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition, AxisHealth
from edge_service.messages.keys import MachineKeys
from edge_service.messages.plant import REPORT, MachineReport
from edge_service.messages.trend import Crossing, Trend, TrendStatus
from edge_service.offline.fleet.rows import rows_of

from ..messages.answers import SILENT, answer

NS = 1_000_000_000
NOW_NS = 1_790_000_000 * NS
AGE_NS = st.integers(0, 10 * NS)
PERCENT = st.floats(0.0, 12.0)
REASONS = st.lists(
    st.sampled_from(
        ("jogs: only short moves", "gap: samples are missing", "gap: many samples are missing")
    ),
    max_size=2,
    unique=True,
).map(tuple)
TIMES = st.none() | st.integers(1, 2_000_000).map(lambda minutes: NOW_NS + minutes * 60 * NS)


@st.composite
def estimates(draw: st.DrawFn) -> PreloadEstimate:
    status = draw(st.sampled_from(EstimateStatus))
    numbers = sorted(draw(st.tuples(PERCENT, PERCENT, PERCENT)))
    known = dict(zip(("low", "preload_percent", "high"), numbers, strict=True))
    return PreloadEstimate(
        time_s=1.0,
        status=status,
        reasons=draw(REASONS),
        **(known if status is EstimateStatus.ESTIMATED else {}),
    )


@st.composite
def trends(draw: st.DrawFn) -> Trend:
    low, value, high = sorted(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3)))
    rate = draw(st.none() | st.just(Interval(value=value, low=low, high=high)))
    crossings = tuple(
        Crossing(
            limit=limit,
            limit_percent=4.0,
            earliest_ns=draw(TIMES),
            likely_ns=draw(TIMES),
            latest_ns=draw(TIMES),
        )
        for limit in ("warning", "fault")
    )
    return Trend(
        status=draw(st.sampled_from(TrendStatus)),
        reason="as drawn",
        since_time_ns=None,
        rate_percent_per_h=rate,
        crossings=crossings if draw(st.booleans()) else (),
    )


@st.composite
def healths(draw: st.DrawFn, estimate: PreloadEstimate) -> AxisHealth:
    alarms = tuple(
        Alarm(
            kind=kind,
            severity=Severity.WARNING,
            active=draw(st.booleans()),
            message="as drawn",
            raised_time_ns=NOW_NS,
        )
        for kind in draw(st.lists(st.sampled_from(AlarmKind), unique=True, max_size=2))
    )
    plain = AxisHealth(
        axis="X",
        condition=draw(st.sampled_from(AxisCondition)),
        reasons=draw(REASONS),
        since_time_ns=NOW_NS,
        alarms=alarms,
        trend=draw(st.none() | trends()),
    )
    return consistent(plain, estimate)


def by_http(state: ServiceState) -> FleetRow:
    """The axis as a program sees it that asks by HTTP."""

    def document(made: Any) -> Any:
        return json.loads(made.model_dump_json())

    axes, health = axes_answer(state, NOW_NS), service_answer(state, NOW_NS)
    preloads = [document(preload_answer(state, "X", NOW_NS))]
    (row,) = rows_of("http://a", document(axes), document(health), preloads)
    return row


def answer_of(state: ServiceState) -> AxisAnswer:
    """The axis as outputs see it."""
    reading, limits = state.preload("X", NOW_NS), state.limits("X")
    return answer(
        estimate=reading.estimate,
        health=state.health("X", NOW_NS),
        fresh_percent=limits and limits.fresh_percent,
        measured_ns=reading.measured_ns,
    )


def seconds_of(moment: str | None) -> float | None:
    return None if moment is None else round(datetime.fromisoformat(moment).timestamp(), 2)


def seconds(time_ns: int | None) -> float | None:
    return None if time_ns is None else round(time_ns / NS, 2)


@settings(max_examples=300, deadline=None)
@given(data=st.data(), age_ns=AGE_NS, knows_fresh=st.booleans(), heard=st.booleans())
def test_both_rows_say_the_same(
    data: st.DataObject, age_ns: int, knows_fresh: bool, heard: bool
) -> None:
    limits = AxisLimits(6.85, 4.0, 2.0, 0.3) if knows_fresh else None
    state = ServiceState({"X": limits}, NOW_NS - 60 * NS, place=MachineKeys("site", "machine"))
    if heard:
        then_ns = NOW_NS - age_ns
        header = Header(0, 1, then_ns, 1)
        estimate = data.draw(estimates())
        state.on_preload("X", header, estimate, then_ns)
        state.on_health(header, data.draw(healths(estimate)), then_ns)
    row, report = by_http(state), axis_report(answer_of(state))
    assert (row.axis, row.condition) == (report.axis, report.condition)
    assert (row.preload_percent, row.low, row.high) == (
        report.preload_percent,
        report.low,
        report.high,
    )
    assert (row.fits, row.limit) == (report.fits, report.limit)
    assert (row.reason, row.task) == (report.reason, report.task)
    assert row.headline == ("" if report.headline is None else report.headline.text)
    assert seconds_of(row.limit_earliest) == seconds(report.limit_earliest_ns)
    assert seconds_of(row.limit_latest) == seconds(report.limit_latest_ns)
    loss = report.loss_per_1000_h
    assert row.loss_percent_per_1000_h == (loss and (loss.value, loss.low, loss.high))
    share = report.preload_percent
    if share is not None:
        share = None if report.fresh_percent is None else 100.0 * share / report.fresh_percent
    assert row.share_percent == share
    age_s = None if report.time_ns is None else (NOW_NS - report.time_ns) / NS
    assert row.age_s == age_s


def test_an_axis_that_nobody_hears_has_no_number_and_says_why() -> None:
    report = axis_report(SILENT)
    assert (report.condition, report.preload_percent, report.time_ns) == ("UNAVAILABLE", None, None)
    assert (report.reason, report.fits, report.limit) == ("not heard yet", None, None)


def test_a_report_comes_back_from_the_wire_as_it_was_and_longest_texts_pass() -> None:
    said = SILENT.health.model_copy(update={"reasons": (f"no_health: {'x' * 5000}",)})
    axes = (axis_report(answer()), axis_report(answer("Y", health=said)))
    report = MachineReport(site="s", machine="m", time_ns=NOW_NS, version="0.1", axes=axes)
    header = Header(1, 2, 3, 4)
    assert REPORT.decode(REPORT.encode(None, header, report)) == ("", header, report)
    assert len(axes[1].reason) == MOST_LETTERS
