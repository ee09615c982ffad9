"""The client of the README hears an alarm of the real service."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

README = (Path(__file__).parents[2] / "README.md").read_text()


@pytest.mark.slow
def test_the_client_of_the_readme_hears_an_alarm(make_service: Any) -> None:
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    source = next(text for text in blocks if "httpx.stream" in text)
    service = make_service(scenario="sudden", life_h=1.0, acceleration=240.0, hold_s=4.0)
    source = source.replace("http://127.0.0.1:8080/", service.address)
    with subprocess.Popen(
        [sys.executable, "-I", "-u", "-c", source], stdout=subprocess.PIPE, text=True
    ) as client:
        assert client.stdout is not None
        line = client.stdout.readline()
        client.kill()
    assert " X " in line
    assert "preload" in line
