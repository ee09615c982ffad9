"""`edge-service doctor`: is a source what its configuration and machine file say?"""

import asyncio
from collections.abc import Sequence
from contextlib import aclosing, suppress
from pathlib import Path
from typing import Any

import numpy as np

from drivers.base import QUIET_S, DriverMisconfiguredError, DriverUnavailableError

from ..checks.examination import check_plausibility
from ..checks.finding import Finding, Verdict
from ..command_answer import Answer
from ..config import AxisConfig, ConfigError, EdgeConfig, EstimatorConfig, load_machine
from ..estimate.interface import ESTIMATORS
from ..exit_status import DONE
from ..messages.samples import Quality, SampleFrame, is_bad, is_uncertain
from ..models.machine import Machine
from ..nodes.acquire_node import make_driver
from ..nodes.stages import make_estimator
from ..recordings.reader import joined
from .recordings import examine_within
from .report.quantities import against

FEW = 0.01
"""Share of samples that may be less than good without a doubt about their source."""
DOUBTED = 1
"""Exit status of a source that was examined and is not all right."""
_MARKS = {Verdict.FITS: "ok", Verdict.DOUBTFUL: "DOUBT", Verdict.UNKNOWN: "?"}


def examine_traces(
    machine_file: Path, traces: Sequence[Path], axis_number: int | None = None
) -> Answer:
    """Check recordings against a machine file. Raises ConfigError and TraceError."""
    machine = load_machine(machine_file, axis_number)
    source = ", ".join(path.name for path in traces)
    return _answer(machine.axis.name, source, examine_within(machine, traces), machine)


async def examine_sources(config: EdgeConfig, axis: str | None, duration_s: float) -> Answer:
    """Read each axis' driver for a while, all at once, and check what it yields.

    Raises ConfigError: no such axis, wrong settings, or a device that refuses them.
    """
    chosen = [each for each in config.axes if axis in (None, each.name)]
    if not config.axes:
        raise ConfigError("axes: none yet")
    if not chosen:
        names = ", ".join(each.name for each in config.axes)
        raise ConfigError(f"--axis: no axis {axis!r}; there are {names}")
    found = await asyncio.gather(*(_examined(each, duration_s) for each in chosen))
    words, status = "\n".join(each.words for each in found), max(each.status for each in found)
    return Answer(words, {"axes": [each.document for each in found]}, status)


async def _examined(axis: AxisConfig, duration_s: float) -> Answer:
    driver, machine = make_driver(axis), load_machine(axis.machine)
    try:
        probe = await driver.probe()
        frames: list[SampleFrame] = []
        await driver.open()
        with suppress(TimeoutError):  # it is silent, or its clock is slow
            async with asyncio.timeout(duration_s + QUIET_S), aclosing(driver.frames()) as source:
                async for frame in source:
                    frames.append(frame)
                    if frame.time_s[-1] - frames[0].time_s[0] >= duration_s:
                        break
    except DriverUnavailableError as error:
        lost = Finding("connection", Verdict.DOUBTFUL, f"not reachable now: {error}")
        return _answer(axis.name, axis.driver, [lost], machine)
    except DriverMisconfiguredError as error:
        raise ConfigError(f"{axis.place}.settings.{error}") from None
    finally:
        await driver.close()
    found = [Finding("connection", Verdict.DOUBTFUL, "no samples came")]
    if frames:
        readings = ", ".join(f"{name} {value:g}" for name, value in driver.readings.items())
        said = f"{sum(map(len, frames))} samples{f'; {readings}' if readings else ''}"
        fine = Finding("connection", Verdict.FITS, said)
        found = [fine, _quality(frames), *check_plausibility(machine, [joined(frames)])]
    return _answer(axis.name, probe.description, found, machine)


def _answer(axis: str, source: str, findings: Sequence[Finding], machine: Machine) -> Answer:
    """A line per check, and whether an estimate is possible; with a doubt the status says so."""
    lines = [f"axis {axis}: {source}"]
    for each in findings:
        said = "" if each.figure is None else against(each.figure, each.expected)
        number = f" [{said}]" if said else ""
        lines.append(f"  {_MARKS[each.verdict]:<6}{each.name:<13}{each.sentence}{number}")
        if each.remedy:
            lines.append(f"        {'':<11}-> {each.remedy}")
    doubts, method = sum(each.is_doubtful for each in findings), _method(machine)
    once = ", once that is right" if any(each.forbids for each in findings) else ""
    able = f"can be estimated{once} (method {method})" if method else "cannot be estimated"
    lines += [f"  {doubts} of {len(findings)} checks raised doubts", f"  the preload {able}"]
    names = ("name", "verdict", "sentence", "compared", "remedy")
    found: list[dict[str, Any]] = []
    for each in findings:
        of = ("value", "low", "high", "unit")
        figure = each.figure and {n: getattr(each.figure, n) for n in of} | {
            "expected": each.expected
        }
        found.append({name: getattr(each, name) for name in names} | {"figure": figure})
    document = {"axis": axis, "source": source, "findings": found, "method": method}
    return Answer("\n".join(lines), document, DOUBTED if doubts else DONE)


def _method(machine: Machine) -> str | None:
    for name in ESTIMATORS:
        with suppress(ConfigError):
            make_estimator(EstimatorConfig(method=name), machine)
            return name
    return None


def _quality(frames: Sequence[SampleFrame]) -> Finding:
    said, most = [], 0.0
    for name in frames[0].channels:
        codes = np.concatenate(
            [frame.quality.get(name, np.zeros(len(frame), dtype=np.uint8)) for frame in frames]
        )
        wrong = codes[is_bad(codes) | is_uncertain(codes)]
        if wrong.size:
            share = wrong.size / codes.size
            most = max(most, share)
            reasons = ", ".join(sorted({Quality(int(code)).name.lower() for code in set(wrong)}))
            said.append(f"{name} {100.0 * share:.2g} % ({reasons})")
    if not said:
        return Finding("quality", Verdict.FITS, "every sample is good")
    verdict = Verdict.FITS if most <= FEW else Verdict.DOUBTFUL
    return Finding("quality", verdict, "not good: " + "; ".join(said))
