"""The register map: numbers in every order, requests that are as few as allowed, clear mistakes."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.modbus.registers import (
    MOST_REGISTERS,
    ModbusConfig,
    RegisterConfig,
    decode_number,
    encode_number,
    plan_requests,
)
from drivers.signals import Sentinels
from edge_service.config.mistakes import explain

PI_WORDS = (0x4049, 0x0FDB)  # IEEE 754: sign 0, exponent 128, mantissa 0x490FDB


@pytest.mark.parametrize(
    ("words", "kind", "word_order", "byte_order", "expected"),
    [
        (PI_WORDS, "float32", "big", "big", math.pi),
        (PI_WORDS[::-1], "float32", "little", "big", math.pi),
        ((0x4940, 0xDB0F), "float32", "big", "little", math.pi),
        ((0xDB0F, 0x4940), "float32", "little", "little", math.pi),
        ((0xFFFE,), "int16", "big", "big", -2),
        ((0xFFFE,), "uint16", "little", "big", 65534),
        ((0xFEFF,), "int16", "big", "little", -2),
        ((0x0001, 0x86A0), "int32", "big", "big", 100_000),
        ((0x86A0, 0x0001), "uint32", "little", "big", 100_000),
        ((0xFFFF, 0xFFFF, 0xFFFF, 0xFFFE), "int64", "big", "big", -2),
        ((0x3FF8, 0, 0, 0), "float64", "big", "big", 1.5),
        ((0, 0, 0, 0x3FF8), "float64", "little", "big", 1.5),
    ],
)
def test_numbers_in_every_order(
    words: Any, kind: Any, word_order: Any, byte_order: Any, expected: float
) -> None:
    number = decode_number(words, kind, word_order, byte_order)
    assert number == pytest.approx(expected, rel=1e-7)
    assert tuple(encode_number(expected, kind, word_order, byte_order)) == tuple(words)


def test_the_end_of_a_type_far_from_the_number_before_stands_for_none() -> None:
    found, values = Sentinels(), (32767, 5, -32768, 32700, 32767, 9)
    assert [found.has("x", value, "int16") for value in values] == [1, 0, 1, 0, 0, 0]
    assert [found.has("y", value, "uint16") for value in (0, 65535, 1)] == [0, 1, 0]
    assert found.has("z", float(np.finfo(np.float32).max), "float32")


def register(address: int, kind: Any = "uint16", table: Any = "holding") -> RegisterConfig:
    return RegisterConfig(channel="torque_command_nm", address=address, type=kind, table=table)


def spans(*registers: RegisterConfig) -> list[tuple[int, int, int]]:
    return [(r.function, r.address, r.count) for r in plan_requests(registers)]


def test_contiguous_registers_are_read_in_one_request() -> None:
    assert spans(register(4, "float64"), register(2, "int32"), register(0, "float32")) == [
        (3, 0, 8)
    ]


@given(st.lists(st.integers(0, 100), unique=True, min_size=1))
def test_every_plan_covers_each_value_once_and_splits_none(places: list[int]) -> None:
    requests = plan_requests([register(4 * place, "float64") for place in places])
    planned = [each.address for request in requests for each in request.registers]
    assert sorted(planned) == sorted(4 * place for place in places)
    for request in requests:
        assert request.count <= MOST_REGISTERS
        for each in request.registers:
            assert request.address <= each.address
            assert each.address + 4 <= request.address + request.count


TORQUE = {"channel": "torque_command_nm", "address": 0}
MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text("utf-8"))


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_names_its_key(name: str) -> None:
    changes = dict(MISTAKES[name])
    expected, groups = changes.pop("said"), {"fast": 0.01, "slow": 1.0}
    settings = {"url": "modbus://mill", "poll_groups": groups, "registers": [TORQUE]} | changes
    with pytest.raises(ValidationError) as caught:
        ModbusConfig.model_validate(settings)
    assert expected in explain(caught.value, ModbusConfig)[0]
