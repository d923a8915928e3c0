"""Which system calls a computation may make: a list of what it needs, as a program for seccomp (Linux)."""

import os
import struct
from collections.abc import Sequence

ARCHITECTURES = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}
"""Number of the architecture (linux/audit.h), and the column of its numbers below."""
LOAD, JUMP_EQUAL, JUMP_FROM, JUMP_SET, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
"""Instructions: load a word, compare (equal; at least; any bit set), return (linux/bpf_common.h)."""
NUMBER, ARCHITECTURE, FIRST_ARGUMENT = 0, 4, 16
"""Where the words stand (struct seccomp_data); of arguments the lower half."""
ALLOW, REFUSE = 0x7FFF0000, 0x00050000
EPERM, ENOTTY, ENOSYS = 1, 25, 38
OTHER_CALLS = 0x40000000
"""From here on calls of another way of calling (x32), which would go past the list."""
NEWER_CALLS = 439
"""From here on calls are so new that libraries go on without them where the kernel has none."""
ABSENT = -1
ALLOWED = {
    "read": (0, 63), "write": (1, 64), "readv": (19, 65), "writev": (20, 66), "pread64": (17, 67),
    "pwrite64": (18, 68), "preadv": (295, 69), "pwritev": (296, 70), "preadv2": (327, 286), "pwritev2": (328, 287),
    "open": (2, -1), "openat": (257, 56), "openat2": (437, 437), "creat": (85, -1), "close": (3, 57),
    "close_range": (436, 436), "dup": (32, 23), "dup2": (33, -1), "dup3": (292, 24), "pipe": (22, -1),
    "pipe2": (293, 59), "lseek": (8, 62), "stat": (4, -1), "fstat": (5, 80), "lstat": (6, -1),
    "newfstatat": (262, 79), "statx": (332, 291), "access": (21, -1), "faccessat": (269, 48),
    "faccessat2": (439, 439), "readlink": (89, -1), "readlinkat": (267, 78), "getdents": (78, -1),
    "getdents64": (217, 61), "getcwd": (79, 17), "statfs": (137, 43), "fstatfs": (138, 44),
    "flock": (73, 32), "ftruncate": (77, 46), "truncate": (76, 45), "fallocate": (285, 47), "fadvise64": (221, 223),
    "readahead": (187, 213), "fsync": (74, 82), "fdatasync": (75, 83), "sync_file_range": (277, 84),
    "copy_file_range": (326, 285), "sendfile": (40, 71), "splice": (275, 76), "mkdir": (83, -1),
    "mkdirat": (258, 34), "rmdir": (84, -1), "unlink": (87, -1), "unlinkat": (263, 35), "rename": (82, -1),
    "renameat": (264, 38), "renameat2": (316, 276), "umask": (95, 166), "chdir": (80, 49), "fchdir": (81, 50),
    "mmap": (9, 222), "munmap": (11, 215), "mprotect": (10, 226), "mremap": (25, 216), "madvise": (28, 233),
    "mincore": (27, 232), "msync": (26, 227), "brk": (12, 214), "membarrier": (324, 283), "memfd_create": (319, 279),
    "mlock": (149, 228), "munlock": (150, 229), "get_mempolicy": (239, 236), "futex": (202, 98),
    "futex_waitv": (449, 449), "set_robust_list": (273, 99), "get_robust_list": (274, 100), "rseq": (334, 293),
    "set_tid_address": (218, 96), "exit": (60, 93), "exit_group": (231, 94), "arch_prctl": (158, -1),
    "gettid": (186, 178), "getpid": (39, 172), "getppid": (110, 173), "getuid": (102, 174), "geteuid": (107, 175),
    "getgid": (104, 176), "getegid": (108, 177), "getgroups": (115, 158), "getresuid": (118, 148),
    "getresgid": (120, 150), "getpgrp": (111, -1), "getpgid": (121, 155), "getsid": (124, 156),
    "rt_sigaction": (13, 134), "rt_sigprocmask": (14, 135), "rt_sigreturn": (15, 139), "rt_sigpending": (127, 136),
    "rt_sigtimedwait": (128, 137), "rt_sigsuspend": (130, 133), "sigaltstack": (131, 132),
    "restart_syscall": (219, 128), "pause": (34, -1), "clock_gettime": (228, 113), "clock_getres": (229, 114),
    "clock_nanosleep": (230, 115), "nanosleep": (35, 101), "gettimeofday": (96, 169), "time": (201, -1),
    "times": (100, 153), "getitimer": (36, 102), "setitimer": (38, 103), "alarm": (37, -1),
    "timer_create": (222, 107), "timer_settime": (223, 110), "timer_gettime": (224, 108), "timer_delete": (226, 111),
    "timerfd_create": (283, 85), "timerfd_settime": (286, 86), "timerfd_gettime": (287, 87),
    "sched_yield": (24, 124), "sched_getaffinity": (204, 123), "sched_getparam": (143, 121),
    "sched_getscheduler": (145, 120), "sched_get_priority_max": (146, 125), "sched_get_priority_min": (147, 126),
    "sched_getattr": (315, 275), "getcpu": (309, 168), "getpriority": (140, 141), "getrandom": (318, 278),
    "getrlimit": (97, 163), "setrlimit": (160, 164), "getrusage": (98, 165), "uname": (63, 160),
    "sysinfo": (99, 179), "prctl": (157, 167), "capget": (125, 90), "poll": (7, -1), "ppoll": (271, 73),
    "select": (23, -1), "pselect6": (270, 72), "epoll_create": (213, -1), "epoll_create1": (291, 20),
    "epoll_ctl": (233, 21), "epoll_wait": (232, -1), "epoll_pwait": (281, 22), "epoll_pwait2": (441, 441),
    "eventfd": (284, -1), "eventfd2": (290, 19), "signalfd4": (289, 74), "wait4": (61, 260), "waitid": (247, 95),
}  # fmt: skip
"""Calls with any arguments, with their numbers on x86-64 and on AArch64. None of them reaches another process."""
OF_NETWORK = {
    "socket": (41, 198), "socketpair": (53, 199), "connect": (42, 203), "bind": (49, 200), "sendto": (44, 206),
    "sendmsg": (46, 211), "sendmmsg": (307, 269), "recvfrom": (45, 207), "recvmsg": (47, 212),
    "recvmmsg": (299, 243), "shutdown": (48, 210), "getsockname": (51, 204), "getpeername": (52, 205),
    "getsockopt": (55, 209), "setsockopt": (54, 208),
}  # fmt: skip
"""What is needed besides to fetch a file."""
CLONE, CLONE3, FCNTL, IOCTL = (56, 220), (435, 435), (72, 25), (16, 29)
SETPRIORITY = (141, 140)
TGKILL, PRLIMIT, SCHED_SETAFFINITY = (234, 131), (302, 261), (203, 122)
CLONE_THREAD = 0x00010000
OWNERS_OF_SIGNALS = (8, 10, 15)
"""F_SETOWN, F_SETSIG, F_SETOWN_EX: by these the kernel sends signals to others."""
DEVICE_REQUESTS = (0x5401, 0x5413, 0x541B, 0x5421, 0x5450, 0x5451, 0x40049409)
"""TCGETS, TIOCGWINSZ, FIONREAD, FIONBIO, FIONCLEX, FIOCLEX, FICLONE."""
Instruction = tuple[int, int, int, int]


def filter_program(machine: str, *, network: bool) -> bytes:
    """Return the program that allows what a computation needs and refuses all else.

    Threads may be made, processes not: `clone` without CLONE_THREAD is refused, and `clone3`, whose flags no program
    can see, does not exist. Signals, limits and processors are those of this process, which has to be the one that
    takes the program.

    Parameters
    ----------
    machine
        As `platform.machine` names it, one of `ARCHITECTURES`.
    network
        Whether servers may be reached.
    """
    architecture, column = ARCHITECTURES[machine]
    own = os.getpid()
    program: list[Instruction] = [
        (LOAD, 0, 0, ARCHITECTURE),
        (JUMP_EQUAL, 1, 0, architecture),
        _refused(EPERM),
        (LOAD, 0, 0, NUMBER),
        (JUMP_FROM, 0, 1, OTHER_CALLS),
        _refused(EPERM),
    ]
    plain = {**ALLOWED, **(OF_NETWORK if network else {})}
    for numbers in plain.values():
        if numbers[column] != ABSENT:
            program += [(JUMP_EQUAL, 0, 1, numbers[column]), ALLOWED_CALL]
    program += _by_argument(CLONE[column], 0, [(JUMP_SET, 0, 1, CLONE_THREAD), ALLOWED_CALL], EPERM)
    program += _by_argument(TGKILL[column], 0, _one_of([own]), EPERM)
    program += _by_argument(PRLIMIT[column], 0, _one_of([0, own]), EPERM)
    program += _by_argument(SCHED_SETAFFINITY[column], 0, _one_of([0, own]), EPERM)
    # of the thread that asks, 0: those that fetch a file step back by themselves
    program += _by_argument(SETPRIORITY[column], 1, _one_of([0]), EPERM)
    program += _by_argument(IOCTL[column], 1, _one_of(DEVICE_REQUESTS), ENOTTY)
    others = [each for command in OWNERS_OF_SIGNALS for each in ((JUMP_EQUAL, 0, 1, command), _refused(EPERM))]
    program += _by_argument(FCNTL[column], 1, [*others, ALLOWED_CALL], EPERM)
    program += [
        (JUMP_EQUAL, 1, 0, CLONE3[column]),
        (JUMP_FROM, 0, 1, NEWER_CALLS),
        _refused(ENOSYS),
        _refused(EPERM),
    ]
    return b"".join(struct.pack("HBBI", *each) for each in program)


ALLOWED_CALL: Instruction = (RETURN, 0, 0, ALLOW)


def _refused(error: int) -> Instruction:
    return (RETURN, 0, 0, REFUSE | error)


def _by_argument(number: int, which: int, test: Sequence[Instruction], error: int) -> list[Instruction]:
    """Return what decides on a call by one of its arguments."""
    body = [(LOAD, 0, 0, FIRST_ARGUMENT + 8 * which), *test, _refused(error)]
    return [(JUMP_EQUAL, 0, len(body), number), *body]


def _one_of(values: Sequence[int]) -> list[Instruction]:
    """Return what allows a call where the argument has one of the values."""
    return [each for value in values for each in ((JUMP_EQUAL, 0, 1, value), ALLOWED_CALL)]
