"""Every folder here is a case: what once was answered wrongly, and how it must be answered."""

from pathlib import Path

import pytest

from .answering import check, estimates
from .assertions import values_at
from .case_file import Window, load_case, load_expected
from .recipes import RecipeError, RecordingsAbsentError, Store

HERE = Path(__file__).parent
FOLDERS = sorted(each for each in HERE.iterdir() if each.is_dir() and each.name != "__pycache__")


def _marked(home: Path) -> object:
    """Parameter of a folder; one that cannot be read fails when it is run."""
    try:
        case = load_case(home)
    except (OSError, ValueError):
        return pytest.param(home, id=home.name)
    marks = [pytest.mark.slow] if case.slow else []
    if case.xfail:
        marks.append(pytest.mark.xfail(reason=case.xfail, raises=AssertionError, strict=True))
    return pytest.param(home, id=home.name, marks=marks)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return Store(tmp_path_factory.mktemp("traces"))


@pytest.mark.parametrize("home", [_marked(each) for each in FOLDERS])
def test_case(home: Path, store: Store, tmp_path: Path) -> None:
    try:
        check(home, store, tmp_path)
    except RecordingsAbsentError as error:
        pytest.skip(str(error))


EMPTY = """
wrong = "An empty file was read as a recording."
run = ["gap --machine {machine} {trace} --json"]
[traces.trace]
text = ""
"""


def made(home: Path, case: str, **expected: str) -> Path:
    """A folder with a case; `err` and `json` are the texts of its expectations."""
    home.mkdir()
    (home / "case.toml").write_text(case)
    for ending, text in expected.items():
        (home / f"expected.{ending}").write_text(text)
    return home


@pytest.mark.parametrize(
    "expected",
    [
        {"err": 'pattern = "no such words"'},
        {"err": 'line = "{trace}"'},
        {"err": 'status = 1\npattern = "{trace}"'},
        {"json": "{}"},
        {"json": '{"status": 2, "answer": [{"path": "torque_nm", "above": 0.0}]}'},
        {
            "json": '{"status": 2, "answer": [{"path": "torque_nm", "above": 0.0}], '
            '"or_refused": "no such words"}'
        },
    ],
)
def test_a_wrong_expectation_fails(tmp_path: Path, store: Store, expected: dict[str, str]) -> None:
    with pytest.raises(AssertionError):
        check(made(tmp_path / "case", EMPTY, **expected), store, tmp_path)


@pytest.mark.parametrize(
    "unknown",
    ["xfial = 'later'", "[traces.other]\ntext = ''\nedit = []", "[windows.a]\nfrom_s = 1.0"],
)
def test_a_case_that_is_misspelt_is_refused(tmp_path: Path, unknown: str) -> None:
    where = EMPTY.replace("[traces", f"{unknown}\n[traces", 1)
    with pytest.raises(ValueError, match=r"xfial|edit|to_s"):
        load_case(made(tmp_path / "case", where))


@pytest.mark.parametrize(
    "expected",
    [
        {},
        {"err": "pattern = ''", "json": "{}"},
        {"err": "status = 2"},
        {"json": '{"answer": [{"path": "a", "bellow": 1}]}'},
        {"json": '{"answer": [{"path": "a"}]}'},
    ],
)
def test_an_expectation_of_nothing_is_refused(tmp_path: Path, expected: dict[str, str]) -> None:
    with pytest.raises(ValueError, match=r"wanted|bellow|asserted"):
        load_expected(made(tmp_path / "case", EMPTY, **expected))


def test_a_recipe_that_makes_nothing_is_no_wrong_answer(tmp_path: Path, store: Store) -> None:
    """An `xfail` expects a false answer; a recipe that makes nothing has to fail in its own way."""
    motion = EMPTY.replace('text = ""', 'simulate = "--motion waltz"')
    with pytest.raises(RecipeError):
        check(made(tmp_path / "case", motion, err='pattern = "waltz"'), store, tmp_path)


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("$", [{"a": [{"n": "x", "p": 1}, {"n": "y", "p": 2}], "b": None}]),
        ("a[*].p", [1, 2]),
        ("a[n=y].p", [2]),
        ("a[-1].n", ["y"]),
        ("a[n=z].p", []),
        ("b", [None]),
        ("b.c", []),
    ],
)
def test_a_path_leads_to_its_values(path: str, values: list[object]) -> None:
    answer = {"a": [{"n": "x", "p": 1}, {"n": "y", "p": 2}], "b": None}
    assert values_at(answer, path) == values


def test_a_window_counts_what_misled(tmp_path: Path) -> None:
    rows = [
        "1,5,4,6,estimated,",
        "2,8,7,9,estimated,table_stuck",
        "3,,,,invalid,",
        "9,1,1,1,invalid,",
    ]
    head = "time_s,preload_percent,low,high,status,reasons"
    (tmp_path / "estimates.csv").write_text("\n".join([head, *rows]) + "\n")
    window = Window(from_s=0.0, to_s=4.0, truth_percent=5.5)
    (said,) = estimates(tmp_path / "estimates.csv", {"all": window}).values()
    assert (said["rows"], said["reasons"]) == (3, ["table_stuck"])
    assert (said["estimated"], said["misled"]) == pytest.approx((2 / 3, 1 / 3))
    assert (said["preload_percent"], said["numbers_without_status"]) == (6.5, 0)
