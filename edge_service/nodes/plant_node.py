"""Reports on all axes to the plant, and a log of them for a plant that was away."""

import logging
import time
from functools import partial

from .. import __version__
from ..bus.plant.reporting import OversizedReportError, Reporting
from ..bus.plant.session import PlantAwayError, PlantSession, PlantSettings
from ..clock import now_ns
from ..config import ConfigError, EdgeConfig
from ..config_tables import PlantConfig
from ..health.axis_report import axis_report
from ..messages.health import ComponentStatus
from ..messages.plant import AxisReport, MachineReport, PlantKeys
from .outputs.latest_answers import LatestAnswers
from .outputs.plant.access import plant_settings
from .outputs.plant.log_keeper import LogKeeper
from .outputs.plant.occasions import Occasions
from .stores.report_log import FILE, ReportLog
from .supervision.heartbeat import Heartbeat
from .supervision.task import TaskChange
from .wiring.context import NodeContext, Reporter

LOOK_PERIOD_S = 0.25
LINK_PERIOD_S = 1.0
RETRY_S = 2.0
log = logging.getLogger(__name__)


async def run(context: NodeContext) -> None:
    """Report until cancelled. Raises ConfigError for what cannot work."""
    plant = context.config.plant
    if plant is None:
        raise ConfigError("plant: missing; the node needs a [plant] table with an endpoint")
    settings, latest = plant_settings(plant), LatestAnswers(context)
    reporter = Reporter(context, "plant")
    keeper = _keeper(context.config, plant, reporter)
    telling = Telling(context.config, plant, latest, keeper)
    reporter.problems = telling.problems
    reporter.counters = telling.counters
    reporter.readings = lambda: {"connected": float(telling.is_connected)}
    try:
        async with reporter.running() as tasks:
            latest.follow(tasks)
            tasks.start("log", keeper.run, may_end=True)
            tasks.start("link", partial(_link, settings, telling, reporter))
            tasks.repeat("reports", min(LOOK_PERIOD_S, plant.period_s), telling.look)
            await context.forever()
    finally:
        await keeper.close(context.heart)


def _keeper(config: EdgeConfig, plant: PlantConfig, reporter: Reporter) -> LogKeeper:
    folder, service = config.history.folder, config.service
    kept = None if folder is None else ReportLog(folder / FILE, round(1e6 * plant.log_mb))

    def tell(words: str) -> None:
        reporter.tell(TaskChange("plant_log_damaged", "log", words, 0))

    return LogKeeper(kept, PlantKeys(service.site, service.machine).log, tell)


class Telling:
    """Teller of the plant.

    Attributes:
        reporting: None before a router was first there.
    """

    def __init__(
        self, config: EdgeConfig, plant: PlantConfig, latest: LatestAnswers, keeper: LogKeeper
    ) -> None:
        service = config.service
        self.keys = PlantKeys(service.site, service.machine)
        self.reporting: Reporting | None = None
        self.session: PlantSession | None = None
        self.keeper, self._latest = keeper, latest
        self._page, self._configuration = plant.page, config.digest
        self._period_s = plant.period_s
        self._occasions = Occasions(plant.period_s, plant.log_period_s)
        self._published, self._oversized = 0, ""

    def join(self, session: PlantSession) -> None:
        """Report on this session from now on."""
        self.session = session
        axes = len(self._latest.axes)
        self.reporting = Reporting(session, self.keys, axes, self._period_s, self.keeper.ask)

    @property
    def is_connected(self) -> bool:
        """Tell whether a router is there now."""
        return self.session is not None and self.session.is_connected

    def problems(self) -> list[str]:
        """Problems beside the link."""
        problem = self.keeper.problem
        disk = f"the disk accepts no data ({problem}); reports are kept in memory"
        return [*([disk] if problem else []), *filter(None, [self._oversized])]

    def counters(self) -> dict[str, int]:
        """Counts since the start."""
        refused = 0 if self.reporting is None else self.reporting.refused
        counts = self.keeper.counters()
        return (
            {"reports": self._published} | counts | {"log_refused": counts["log_refused"] + refused}
        )

    def look(self) -> None:
        """Publish and log what is due now."""
        now_s = time.monotonic()
        axes = tuple(axis_report(answer) for answer in self._latest.now())
        if self._occasions.to_log(axes, now_s):
            self.keeper.put(self._report(axes))
        if self.reporting is not None and self._occasions.to_publish(axes, now_s):
            report = self._report(axes).model_copy(update={"log": self.keeper.state})
            try:
                self.reporting.publish(report)
                self._published, self._oversized = self._published + 1, ""
            except OversizedReportError as error:
                self._oversized = str(error)

    def _report(self, axes: tuple[AxisReport, ...]) -> MachineReport:
        return MachineReport(
            site=self.keys.site,
            machine=self.keys.machine,
            time_ns=now_ns(),
            period_s=self._period_s,
            version=__version__,
            configuration=self._configuration,
            page=self._page,
            axes=axes,
        )


async def _link(
    settings: PlantSettings, telling: Telling, reporter: Reporter, heart: Heartbeat
) -> None:
    """Join a router as soon as one is there; then the session comes back by itself."""
    away = f"no router answers at {settings.endpoint}; reports wait for it"
    session = await _joined(settings, reporter, heart)
    try:
        telling.join(session)
        while True:
            _show(reporter, "" if session.is_connected else away)
            await heart.sleep(LINK_PERIOD_S)
    finally:
        reporting, telling.reporting, telling.session = telling.reporting, None, None
        if reporting is not None:
            reporting.close()
        await session.close()


async def _joined(settings: PlantSettings, reporter: Reporter, heart: Heartbeat) -> PlantSession:
    while True:
        try:
            return await heart.patiently(PlantSession.open(settings))
        except PlantAwayError as error:
            _show(reporter, str(error))
            await heart.sleep(RETRY_S)


def _show(reporter: Reporter, problem: str) -> None:
    """Say how the link is; the log only what has changed."""
    status = ComponentStatus.RECOVERABLE_ERROR if problem else ComponentStatus.OK
    if reporter.status is not status:
        log.warning("plant: %s", problem) if problem else log.info("plant: connected")
        reporter.to(status, problem)
