"""Rows of the reproduced thesis, and their tables for a terminal."""

from dataclasses import dataclass

from .plant import Discretisation
from .runs import (
    TABLE_WINDOW_STEPS,
)


@dataclass(frozen=True, slots=True)
class LevelRow:
    """One constant level: the published row of Table 4.2 and ours, percent.

    Attributes:
        probability, linear_percent, percent: mean over runs of constant preload.
        sliding_percent: the same of the sliding innovation bank.
        ramp_percent: read from the ramp of simulation 1 where it passes the level, with a centred
            window of TABLE_WINDOW_STEPS, which comes closest to the published table.
    """

    actual_percent: float
    published_probability: tuple[float, ...]
    published_linear_percent: float
    published_percent: float
    probability: tuple[float, ...]
    linear_percent: float
    percent: float
    sliding_percent: float
    ramp_percent: float


@dataclass(frozen=True, slots=True)
class WindowRow:
    """One causal window: mean absolute error in points of simulations 1 to 5, and its reaction.

    Attributes:
        drop_steps: most steps that any run of simulation 4 took to see the drop; None if one
            never did.
        false_drop_share: share of the runs of simulation 3 with a false drop.
    """

    window_steps: int
    mae_points: tuple[float, ...]
    drop_steps: int | None
    false_drop_share: float


@dataclass(frozen=True, slots=True)
class StepRow:
    """One step length and discretisation; prediction at each level, error in simulations 1 to 4."""

    step_s: float
    discretisation: Discretisation
    rescaled: bool
    percent: tuple[float, ...]
    diagonal: tuple[float, ...]
    mae_points: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Everything that the study found."""

    seeds: int
    short_step_seeds: int
    levels: tuple[LevelRow, ...]
    windows: tuple[WindowRow, ...]
    steps: tuple[StepRow, ...]
    printed_states_difference: float
    printed_states_difference_points: float

    @property
    def scenario_mae_points(self) -> tuple[float, ...]:
        """Mean absolute error of simulations 1 to 5 with the window of MAE_WINDOW_STEPS."""
        return self.window(MAE_WINDOW_STEPS).mae_points

    @property
    def own_probability(self) -> tuple[float, ...]:
        """Probability of the right mode at each constant level."""
        return tuple(row.probability[index] for index, row in enumerate(self.levels))

    def window(self, steps: int) -> WindowRow:
        """The row of one window."""
        return next(row for row in self.windows if row.window_steps == steps)

    def as_text(self) -> str:
        """The tables, for a terminal."""
        return "\n\n".join([self._levels_text(), self._windows_text(), self._steps_text()])

    def _levels_text(self) -> str:
        lines = [
            f"Table 4.2, constant levels, mean of {self.seeds} seeds, exponent 1.33 "
            "(published in brackets)",
            f"ramp: read from simulation 1, centred window of {TABLE_WINDOW_STEPS} steps",
            "actual   own mode     linear       exp 1.33      sliding  ramp",
        ]
        for index, row in enumerate(self.levels):
            lines.append(
                f"{row.actual_percent:5.1f} %"
                f"  {row.probability[index]:.2f} ({row.published_probability[index]:.2f})"
                f"  {row.linear_percent:5.2f} ({row.published_linear_percent:4.1f})"
                f"  {row.percent:5.2f} ({row.published_percent:4.1f})"
                f"  {row.sliding_percent:6.2f}  {row.ramp_percent:5.2f}"
            )
        return "\n".join(lines)

    def _windows_text(self) -> str:
        lines = [
            "Mean absolute error in points, causal moving average, exponent 1.33",
            "window   sim 1  sim 2  sim 3  sim 4  sim 5  drop seen after  false drops in sim 3",
        ]
        for row in self.windows:
            errors = "  ".join(f"{value:.3f}" for value in row.mae_points)
            seen = "never" if row.drop_steps is None else f"{row.drop_steps} steps"
            lines.append(
                f"{row.window_steps:6d}   {errors}  {seen:>15}  {row.false_drop_share:20.0%}"
            )
        return "\n".join(lines)

    def _steps_text(self) -> str:
        lines = [
            "Step length: prediction at 10, 7.5, 5, 2.5, 0 % and error in simulations 1 to 4 "
            "(window 2 s)",
        ]
        for row in self.steps:
            predictions = " ".join(f"{value:5.2f}" for value in row.percent)
            errors = " ".join(f"{value:.3f}" for value in row.mae_points)
            matrix = "rescaled" if row.rescaled else "printed "
            lines.append(
                f"{row.step_s:5g} s  {row.discretisation:5}  {matrix}  {predictions}   {errors}"
            )
        return "\n".join(lines)


MAE_WINDOW_STEPS = 20
