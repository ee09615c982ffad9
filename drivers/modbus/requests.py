"""Grouping of registers into read requests."""

from collections.abc import Iterable
from dataclasses import dataclass

from .config import FUNCTION_OF, MOST_REGISTERS, ModbusConfig, RegisterConfig


@dataclass(frozen=True, slots=True)
class ReadRequest:
    """One read: function code, first address, number of registers, and what is wanted of it."""

    function: int
    address: int
    count: int
    registers: tuple[RegisterConfig, ...]


def plan_requests(registers: Iterable[RegisterConfig], max_gap: int = 0) -> tuple[ReadRequest, ...]:
    """As few requests as possible, in the order of function and address.

    Contiguous registers are read together, up to 125 at once; no value is split. Registers that
    nobody asked for are read along only where at most `max_gap` of them lie between: a device may
    refuse a whole request for one register that it does not have.
    """
    runs: list[list[RegisterConfig]] = []
    ordered = sorted(registers, key=lambda each: (FUNCTION_OF[each.table], each.address))
    for register in ordered:
        if not runs or not _joins(runs[-1], register, max_gap):
            runs.append([])
        runs[-1].append(register)
    return tuple(
        ReadRequest(
            FUNCTION_OF[run[0].table], run[0].address, _end(run) - run[0].address, tuple(run)
        )
        for run in runs
    )


def plan_group(config: ModbusConfig, group: str) -> tuple[ReadRequest, ...]:
    """The requests of one poll group."""
    members = (each for each in config.registers if config.group_of(each) == group)
    return plan_requests(members, config.max_gap)


def _end(run: list[RegisterConfig]) -> int:
    return max(each.address + each.words for each in run)


def _joins(run: list[RegisterConfig], register: RegisterConfig, max_gap: int) -> bool:
    end = max(_end(run), register.address + register.words)
    return (
        run[0].table == register.table
        and register.address - _end(run) <= max_gap
        and end - run[0].address <= MOST_REGISTERS
    )
