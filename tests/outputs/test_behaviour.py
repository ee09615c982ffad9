"""Behaviour of every output; one enrols by being installed.

Its folder here has a `bench.py` with one function, `bench(folder)`: an asynchronous context manager
that yields an `OutputBench`.
"""

import asyncio
import importlib
import logging
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio
from pydantic import ValidationError

from edge_service.nodes.output_node import within
from edge_service.outputs import base
from edge_service.plugins import plugins

from ..messages.answers import SILENT, answer
from ..nodes.conftest import until
from .bench import SECRET, OutputBench, event

PATIENCE_S = 60.0
TOLD = [name for name in plugins("edge_service.outputs") if name != "metrics"]
"""Outputs with another side."""


@pytest_asyncio.fixture(params=TOLD)
async def bench(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[OutputBench]:
    module = importlib.import_module(f".{request.param}.bench", __package__)
    async with module.bench(tmp_path) as built:
        yield built


def messages(output: base.Output) -> list[base.Message]:
    events = [base.Events(receiver, (event(),)) for receiver in output.receivers]
    return [*([answer()] if output.takes_answers else []), *events]


async def test_the_other_side_hears_and_what_is_closed_opens_again(bench: OutputBench) -> None:
    output = bench.make()
    for _life in range(2):
        await output.open()
        await output.open()
        for message in messages(output):
            await output.take(message)
        await until(bench.heard)
        if output.takes_answers:
            await output.take(SILENT)
        await output.close()
        await output.close()


async def test_what_is_not_open_takes_nothing(bench: OutputBench) -> None:
    output = bench.make()
    await output.close()
    for message in messages(output):
        with pytest.raises(base.OutputUnavailableError):
            await output.take(message)


async def test_who_is_away_is_told_once_back(
    bench: OutputBench, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    output = bench.make()
    await bench.lose()
    try:
        with pytest.raises(base.OutputUnavailableError) as caught:
            async with asyncio.timeout(PATIENCE_S):
                await output.open()
                for message in messages(output):
                    await output.take(message)
        assert "\n" not in str(caught.value)
        assert SECRET not in str(caught.value) + caplog.text
        await bench.bring_back()
        async with asyncio.timeout(PATIENCE_S):
            while True:
                try:
                    await output.open()
                    for message in messages(output):
                        await output.take(message)
                    break
                except base.OutputUnavailableError:
                    await asyncio.sleep(0.05)
        await until(bench.heard)
    finally:
        await output.close()


async def test_who_hangs_is_left(bench: OutputBench) -> None:
    if bench.hanging is None:
        pytest.skip("nobody is asked for anything")
    output = bench.hanging()
    try:
        with pytest.raises(base.OutputUnavailableError) as caught:
            await within(0.2, output.open())
            for message in messages(output):
                await within(0.2, output.take(message))
        assert SECRET not in str(caught.value)
    finally:
        await output.close()


async def test_who_refuses_an_event_holds_up_no_other(
    bench: OutputBench, caplog: pytest.LogCaptureFixture
) -> None:
    if bench.refusing is None:
        pytest.skip("nobody refuses")
    caplog.set_level(logging.DEBUG)
    output = bench.refusing()
    try:
        await output.open()
        for receiver in output.receivers:
            with pytest.raises(base.RefusedError) as caught:
                await output.take(base.Events(receiver, (event(f"a message with {SECRET}"),)))
            assert "\n" not in str(caught.value)
        assert SECRET not in str(caught.value) + caplog.text
    finally:
        await output.close()


@pytest.mark.parametrize("name", plugins("edge_service.outputs"))
def test_what_no_output_knows_is_refused(name: str) -> None:
    with pytest.raises(ValidationError):
        base.load_output(name).config_model.model_validate({"no_such_key": 1})
