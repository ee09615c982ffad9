"""A case as its folder says it: `case.toml`, `machine.toml`, `expected.json` or `expected.err`."""

import json
import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Strict(BaseModel):
    """A table in which an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Edit(Strict):
    """Faults of the recorder; `scale` and `shift` name channels and numbers, others channels."""

    drop: list[str] = []
    rename: dict[str, str] = {}
    scale: dict[str, float] = {}
    shift: dict[str, float] = {}
    unsigned: list[str] = []
    stuck: list[str] = []
    missing: list[str] = []
    value: dict[str, float] = {}
    old_rows: dict[str, int] = {}
    held_rows: dict[str, int] = {}
    steps: dict[str, float] = {}
    wrap: dict[str, float] = {}
    interpolated_rows: int = Field(1, description="of so many, all but the first are drawn")
    noise: dict[str, float] = {}
    drag_nm: float = Field(0.0, description="added to the torque, with the sign of the speed")
    repeated_rows: float = 0.0
    missing_rows: float = 0.0
    newest_first: bool = False
    clock_jump_s: float = 0.0
    clock_restart: bool = False
    between_s: tuple[float, float] | None = Field(
        None, description="only there: scale, shift, stuck, missing, value, old_rows"
    )
    share: float = Field(1.0, description="of the cells: shift, missing, value, old_rows")


class Foreign(Strict):
    """A case of `tests/foreign_plant`: `axis_case`, `commissioning_case` or `case`."""

    case: Literal["axis_case", "commissioning_case", "case"] = "axis_case"
    arguments: dict[str, Any] = {}
    preload: float | None = None
    effects: dict[str, float] = {}
    events: list[dict[str, Any]] = []
    motion: list[tuple[Literal["production", "jogs", "standstill"], float]] = []


class Real(Strict):
    """A recording in shared/data beside the checkout."""

    file: str
    every_s: float | None = Field(None, description="time of a row, where the file has none")
    condition: str | None = Field(None, description="Cranfield's, with `load_kgf` and `parts`")
    load_kgf: int = 20
    parts: list[int] = [0]


class Trace(Strict):
    """A file to read: one source, then edits of its columns, then damage to the file."""

    simulate: str | None = None
    foreign: Foreign | None = None
    real: Real | None = None
    text: str | None = None
    hexadecimal: str | None = None
    folder: bool = False
    edits: list[Edit] = []
    nan: bool = Field(False, description="a missing value is the word nan, not an empty cell")
    name: str = Field("trace.csv", description="of the file; .parquet makes it one")
    replace: dict[str, str] = Field({}, description="expression -> text in its place, in order")
    torn: float = Field(1.0, description="share of the bytes that are left")

    @model_validator(mode="after")
    def _one_source(self) -> "Trace":
        sources = (self.simulate, self.foreign, self.real, self.text, self.hexadecimal)
        if sum(each is not None for each in sources) + self.folder != 1:
            raise ValueError("one of simulate, foreign, real, text, hexadecimal, folder is wanted")
        return self


class Window(Strict):
    """A span of the estimates, and the preload that was true in it."""

    from_s: float
    to_s: float
    truth_percent: float | None = None


class Case(Strict):
    wrong: str = Field(description="one sentence: the false answer that must not come again")
    run: list[str] = Field([], description="commands, one after another; the last one answers")
    request: str | None = Field(None, description="instead: GET path of the HTTP interface")
    machine: str = Field("machine", description="deploy/NAME.toml, or one that recipes name")
    commission: list[str] = Field([], description="traces from which {machine} is learned first")
    traces: dict[str, Trace] = {}
    windows: dict[str, Window] = {}
    slow: bool = False
    xfail: str | None = Field(None, description="why the answer is wrong today")

    @model_validator(mode="after")
    def _one_question(self) -> "Case":
        if bool(self.run) == (self.request is not None):
            raise ValueError("either run or request is wanted")
        return self


class Refusal(Strict):
    """Content of `expected.err`: the exit status and the line on stderr."""

    status: int = 2
    line: str | None = None
    pattern: str | None = None

    @model_validator(mode="after")
    def _one_wording(self) -> "Refusal":
        if (self.line is None) == (self.pattern is None):
            raise ValueError("either line or pattern is wanted")
        return self


class Assertion(Strict):
    """A statement on every value at `path` of the answer."""

    path: str
    equals: Any = None
    below: float | None = None
    above: float | None = None
    one_of: list[Any] | None = None
    none_of: list[Any] | None = None
    contains: Any = None
    mentions: str | None = Field(None, description="a word anywhere in the value")
    absent: bool | None = None
    if_present: bool = False

    @model_validator(mode="after")
    def _says_something(self) -> "Assertion":
        if not self.model_fields_set - {"path", "if_present"}:
            raise ValueError(f"{self.path}: nothing is asserted")
        return self


class Answer(Strict):
    """Content of `expected.json`; `or_refused`: such a line with status 2 would do as well."""

    status: int = 0
    answer: list[Assertion] = []
    or_refused: str | None = None


def load_case(folder: Path) -> Case:
    """Read `case.toml`; an unknown key is a `ValueError`."""
    return Case.model_validate(tomllib.loads((folder / "case.toml").read_text()))


def load_expected(folder: Path) -> Answer | Refusal:
    """Read the one expectation of a folder; none, or two, is a `ValueError`."""
    answer, refusal = folder / "expected.json", folder / "expected.err"
    if answer.exists() == refusal.exists():
        raise ValueError(f"{folder.name}: either expected.json or expected.err is wanted")
    if answer.exists():
        return Answer.model_validate(json.loads(answer.read_text()))
    return Refusal.model_validate(tomllib.loads(refusal.read_text()))
