"""The list of system calls holds on both architectures: its numbers, and what its program decides, run here by hand."""

import ctypes
import errno
import os
import struct
from collections.abc import Mapping
from contextlib import suppress

import pytest

from service.adapters.processes import system_calls as calls

BY_ARGUMENT = {
    "clone": calls.CLONE, "clone3": calls.CLONE3, "fcntl": calls.FCNTL, "ioctl": calls.IOCTL,
    "setpriority": calls.SETPRIORITY, "tgkill": calls.TGKILL, "prlimit64": calls.PRLIMIT,
    "sched_setaffinity": calls.SCHED_SETAFFINITY,
}  # fmt: skip
NUMBERS: Mapping[str, tuple[int, int]] = {**calls.ALLOWED, **calls.OF_NETWORK, **BY_ARGUMENT}
MACHINES = pytest.mark.parametrize("machine", calls.ARCHITECTURES)


@MACHINES
def test_the_numbers_are_those_of_libseccomp(machine: str) -> None:
    library = None
    with suppress(OSError):
        library = ctypes.CDLL("libseccomp.so.2")
    if library is None:
        pytest.skip("libseccomp, which knows the numbers of all architectures, is not on this machine")
    architecture, column = calls.ARCHITECTURES[machine]
    number = library.seccomp_syscall_resolve_name_arch
    found = {name: max(calls.ABSENT, number(ctypes.c_uint32(architecture), name.encode())) for name in NUMBERS}
    assert found == {name: numbers[column] for name, numbers in NUMBERS.items()}


@MACHINES
@pytest.mark.parametrize("network", [False, True])
def test_the_program_allows_what_is_listed_and_nothing_else(machine: str, network: bool) -> None:
    architecture, column = calls.ARCHITECTURES[machine]
    program = calls.filter_program(machine, network=network)
    listed = {numbers[column] for numbers in {**calls.ALLOWED, **(calls.OF_NETWORK if network else {})}.values()}
    decided = {number: decision(program, number, architecture) for number in range(600)}
    by_argument = {numbers[column] for numbers in BY_ARGUMENT.values()}
    assert {number for number, allowed in decided.items() if allowed == 0} - by_argument == listed - {calls.ABSENT}
    clone, fcntl, tgkill = (BY_ARGUMENT[name][column] for name in ("clone", "fcntl", "tgkill"))
    assert decision(program, clone, architecture, calls.CLONE_THREAD | 0x100) == 0
    assert decision(program, clone, architecture, 17) == errno.EPERM
    assert decision(program, fcntl, architecture, 0, 8) == errno.EPERM
    assert decision(program, fcntl, architecture, 0, 1) == 0
    assert decision(program, tgkill, architecture, os.getpid()) == 0
    assert decision(program, tgkill, architecture, os.getpid() + 1) == errno.EPERM
    assert decision(program, calls.CLONE3[column], architecture) == errno.ENOSYS
    assert decision(program, calls.OTHER_CALLS, architecture) == errno.EPERM
    other = next(each for each, _ in calls.ARCHITECTURES.values() if each != architecture)
    assert decision(program, clone, other, calls.CLONE_THREAD) == errno.EPERM


def decision(program: bytes, number: int, architecture: int, *arguments: int) -> int:
    """Run a program of seccomp on a call; return the error it is answered with, 0 where it is allowed."""
    data = struct.pack("<IIQ6Q", number, architecture, 0, *arguments, *[0] * (6 - len(arguments)))
    instructions, at, word = list(struct.iter_unpack("HBBI", program)), 0, 0
    while True:
        code, met, unmet, value = instructions[at]
        at += 1
        if code == calls.RETURN:
            return 0 if value == calls.ALLOW else value ^ calls.REFUSE
        if code == calls.LOAD:
            (word,) = struct.unpack_from("<I", data, value)
        else:
            tests = {calls.JUMP_EQUAL: word == value, calls.JUMP_FROM: word >= value, calls.JUMP_SET: word & value}
            at += met if tests[code] else unmet
