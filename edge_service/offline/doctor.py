"""`edge-service doctor`: is a source what its configuration and machine file say?"""

import asyncio
from collections.abc import Sequence
from contextlib import aclosing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.base import Driver, DriverMisconfiguredError, DriverUnavailableError

from ..checks.examination import check_plausibility
from ..checks.finding import Finding, Verdict
from ..command_answer import Answer
from ..config import AxisConfig, ConfigError, EdgeConfig, load_machine
from ..exit_status import DONE
from ..messages.arrays import finite_or_none
from ..messages.quality import Quality, is_bad, is_uncertain
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..nodes.acquire_node import make_driver
from .document import Document
from .examination import examine
from .recordings import Progress, silent
from .report.quantities import against

FEW = 0.01
"""Share of samples that may be less than good without a doubt about their source."""
DOUBTED = 1
"""Exit status of a source that was examined and is not all right."""
_MARKS = {Verdict.FITS: "ok", Verdict.DOUBTFUL: "DOUBT", Verdict.UNKNOWN: "?"}


class Number(Document):
    """A measured number beside what was expected, in `unit`; null where there is none."""

    value: float | None
    low: float | None
    high: float | None
    unit: str
    expected: float | None


class FindingDocument(Document):
    """One check."""

    name: str
    verdict: Verdict
    sentence: str
    figure: Number | None
    compared: str
    remedy: str


class Examined(Document):
    """Findings about one axis."""

    axis: str
    source: str
    findings: list[FindingDocument]


@dataclass(frozen=True, slots=True)
class Examination:
    """Findings about one axis."""

    axis: str
    source: str
    findings: tuple[Finding, ...]

    @property
    def doubts(self) -> int:
        """Number of checks that found something wrong."""
        return sum(finding.is_doubtful for finding in self.findings)

    def as_text(self) -> str:
        """A line per check."""
        lines = [f"axis {self.axis}: {self.source}"]
        for each in self.findings:
            said = "" if each.figure is None else against(each.figure, each.expected)
            number = f" [{said}]" if said else ""
            lines.append(f"  {_MARKS[each.verdict]:<6}{each.name:<13}{each.sentence}{number}")
            if each.remedy:
                lines.append(f"        {'':<11}-> {each.remedy}")
        lines.append(f"  {self.doubts} of {len(self.findings)} checks raised doubts")
        return "\n".join(lines)

    def answer(self) -> Answer:
        """Words and document; with a doubt the exit status says so."""
        findings = [_finding(each) for each in self.findings]
        document = Examined(axis=self.axis, source=self.source, findings=findings)
        return Answer(self.as_text(), document, DOUBTED if self.doubts else DONE)


def examine_traces(
    machine_file: Path,
    traces: Sequence[Path],
    axis_number: int | None = None,
    progress: Progress = silent,
) -> Examination:
    """Check recordings against a machine file. Raises ConfigError and TraceError."""
    machine = load_machine(machine_file, axis_number)
    source = ", ".join(path.name for path in traces)
    return Examination(machine.axis.name, source, tuple(examine(machine, traces, progress)))


async def examine_sources(
    config: EdgeConfig, axis: str | None, seconds: float
) -> list[Examination]:
    """Read each axis' driver for some seconds, all at once, and check what it yields.

    Raises:
        ConfigError: no such axis, wrong settings, or a device that refuses them.
    """
    chosen = [each for each in config.axes if axis in (None, each.name)]
    if not chosen:
        names = ", ".join(each.name for each in config.axes)
        raise ConfigError(f"--axis: no axis {axis!r}; there are {names}")
    return list(await asyncio.gather(*(_examine(each, seconds) for each in chosen)))


async def _examine(axis: AxisConfig, seconds: float) -> Examination:
    driver, machine = make_driver(axis), load_machine(axis.machine)
    try:
        probe = await driver.probe()
        frames = await _listen(driver, seconds)
    except DriverUnavailableError as error:
        lost = Finding("connection", Verdict.DOUBTFUL, f"not reachable now: {error}")
        return Examination(axis.name, axis.driver, (lost,))
    except DriverMisconfiguredError as error:
        raise ConfigError(f"{axis.place}.settings.{error}") from None
    finally:
        await driver.close()
    return Examination(axis.name, probe.description, _findings(machine, driver, frames))


async def _listen(driver: Driver, seconds: float) -> list[SampleFrame]:
    """Frames of that much axis time, or of all there are."""
    frames: list[SampleFrame] = []
    await driver.open()
    async with aclosing(driver.frames()) as source:
        async for frame in source:
            frames.append(frame)
            if frame.time_s[-1] - frames[0].time_s[0] >= seconds:
                break
    return frames


def _findings(
    machine: Machine, driver: Driver, frames: Sequence[SampleFrame]
) -> tuple[Finding, ...]:
    if not frames:
        return (Finding("connection", Verdict.DOUBTFUL, "no samples came"),)
    rows = sum(map(len, frames))
    readings = ", ".join(f"{name} {value:g}" for name, value in driver.readings.items())
    said = f"{rows} samples; {readings}" if readings else f"{rows} samples"
    fine = Finding("connection", Verdict.FITS, said)
    whole = SampleFrame(
        np.concatenate([frame.time_s for frame in frames]),
        {
            name: np.concatenate([frame.channels[name] for frame in frames])
            for name in frames[0].channels
        },
    )
    return (fine, _quality(frames), *check_plausibility(machine, [whole]))


def _quality(frames: Sequence[SampleFrame]) -> Finding:
    """Channels that had samples that were not good, and why."""
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


def _finding(found: Finding) -> FindingDocument:
    figure = found.figure
    number = None
    if figure is not None:
        number = Number(
            value=finite_or_none(figure.value),
            low=finite_or_none(figure.low),
            high=finite_or_none(figure.high),
            unit=figure.unit,
            expected=found.expected,
        )
    return FindingDocument(
        name=found.name,
        verdict=found.verdict,
        sentence=found.sentence,
        figure=number,
        compared=found.compared,
        remedy=found.remedy,
    )
