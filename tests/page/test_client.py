"""The client of the operators' guide hears an alarm of the real service."""

import subprocess
import sys
from typing import Any

import pytest

from ..documents import block


@pytest.mark.slow
def test_the_client_of_the_readme_hears_an_alarm(make_service: Any) -> None:
    source = block("guide", "python", "httpx.stream")
    service = make_service(scenario="sudden", life_s=15.0, hold_s=4.0)
    source = source.replace("http://127.0.0.1:8080/", service.address)
    with subprocess.Popen(
        [sys.executable, "-I", "-u", "-c", source], stdout=subprocess.PIPE, text=True
    ) as client:
        assert client.stdout is not None
        line = client.stdout.readline()
        client.kill()
    assert " X " in line
    assert "preload" in line
