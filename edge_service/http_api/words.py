"""Words of the page, for whoever speaks to people beside it."""

import json
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

STRINGS = Path(__file__).with_name("static") / "strings"
_LINE = re.compile(r'^  "([^"]+)": (".*"),$', re.MULTILINE)


@cache
def words_in(language: str) -> Mapping[str, str]:
    """Text of each key, in a language that the page has."""
    text = (STRINGS / f"{language}.js").read_text(encoding="utf-8")
    return {key: json.loads(value) for key, value in _LINE.findall(text)}
