"""Take from a process, for good, all that one computation does not need (Linux: no_new_privs, Landlock, seccomp).

A parser that is taken over by a hostile file then sees the files of its step, the libraries and a scratch directory,
reaches no network and starts no program. Nothing here needs privileges. What a kernel does not have is left out, and
said.
"""

import ctypes
import importlib
import os
import platform
import site
import struct
import sys
import sysconfig
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from service.adapters.processes.system_calls import ARCHITECTURES, filter_program

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Landlock's system calls, the same on every architecture."""
ASK_VERSION, BENEATH = 1, 1
READ_FILE, READ_DIRECTORY, WRITE_FILE, TRUNCATE = 1 << 2, 1 << 3, 1 << 1, 1 << 14
FILE_RIGHTS_OF_VERSION = ((1, 13), (2, 14), (3, 15), (5, 16))
"""From a version on, so many rights of files are known."""
NET_VERSION, SCOPE_VERSION = 4, 6
NO_NEW_PRIVILEGES, SECCOMP, GET_SECCOMP, FILTER = 38, 22, 21, 2
SYSTEM: tuple[str, ...] = (
    "/usr",
    "/lib",
    "/lib64",
    "/bin",
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/sys/devices/system",
    "/dev/null",
)
SYSTEM += ("/dev/zero", "/dev/urandom", "/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/proc/stat")
SYSTEM_OF_NETWORK: tuple[str, ...] = (
    "/etc/resolv.conf",
    "/etc/hosts",
    "/etc/nsswitch.conf",
    "/etc/host.conf",
    "/etc/gai.conf",
    "/etc/services",
    "/etc/ssl",
    "/etc/pki",
    "/etc/ca-certificates",
    "/run/systemd/resolve",
)
"""How names of hosts become addresses, and which certificates are trusted."""
VARIABLES_OF_NETWORK = (
    "SSL_CERT_FILE",
    "SSL_CERT_DIR",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE",
    "AWS_SHARED_CREDENTIALS_FILE",
    "AWS_CONFIG_FILE",
)
"""Name files that are read for it."""


@dataclass(frozen=True)
class Confinement:
    """What this machine's kernel has for it."""

    landlock: int
    """Version; 0: none."""
    seccomp: bool

    @property
    def text(self) -> str:
        """Say what is on."""
        files = f"files and scopes by Landlock {self.landlock}" if self.landlock else "no Landlock"
        return f"{files}, {'system calls by seccomp' if self.seccomp else 'no seccomp'}"


def available() -> Confinement:
    """Find out what there is, without changing anything."""
    if sys.platform != "linux":
        return Confinement(0, False)
    library = ctypes.CDLL(None, use_errno=True)
    version = library.syscall(CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint(ASK_VERSION))
    known = platform.machine() in ARCHITECTURES and library.prctl(GET_SECCOMP, 0, 0, 0, 0) >= 0
    return Confinement(max(0, int(version)), bool(known))


def confine(files: Sequence[Path], scratch: Path, data_dir: Path, *, network: bool = False) -> Confinement:
    """Leave this process some files to read, one directory to write in, and the libraries. There is no way back.

    Parameters
    ----------
    files
        What is read.
    scratch
        May be written to.
    data_dir
        Is not read beyond these, even where a path of libraries leads there.
    network
        Leave it the network as well.

    Raises
    ------
    OSError
        The kernel has what it takes, and refuses it.
    """
    found = available()
    if found.landlock or found.seccomp:
        _checked(ctypes.CDLL(None, use_errno=True).prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0), "no_new_privs")
    if found.landlock:
        readable = [*map(Path, SYSTEM), *_libraries(data_dir.resolve()), *(file.resolve() for file in files)]
        if network:
            named = (os.environ[name] for name in VARIABLES_OF_NETWORK if os.environ.get(name))
            readable += map(Path, (*SYSTEM_OF_NETWORK, *named))
        _restrict_files(found.landlock, readable, [scratch.resolve(), Path("/dev/null")], network=network)
    if found.seccomp:
        _restrict_calls(network=network)
    return found


def _libraries(data_dir: Path) -> Iterable[Path]:
    """Return where this program and its libraries are installed, but no directory in which the data lie as well.

    Not all of `sys.path`: a program that is not installed lies in a directory with much else beside its packages.
    """
    for name in ("service", "schemas", "algorithms"):
        importlib.import_module(name)
    loaded = [module for name, module in tuple(sys.modules.items()) if "." not in name]
    packages = [place for module in loaded for place in getattr(module, "__path__", ())]
    installed = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    installed += [*site.getsitepackages(), sysconfig.get_config_var("LIBDIR") or ""]
    if site.ENABLE_USER_SITE:
        installed.append(site.getusersitepackages())
    for place in (*map(Path, filter(None, (*packages, *installed))), *_kernels()):
        resolved = place.resolve()
        if not data_dir.is_relative_to(resolved):
            yield resolved


def _kernels() -> Iterable[Path]:
    """Give where compiled kernels may be kept other than beside the program."""
    if os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(os.environ["NUMBA_CACHE_DIR"])
    yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"


def _restrict_files(version: int, readable: Sequence[Path], writable: Sequence[Path], *, network: bool) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    rights = max(number for since, number in FILE_RIGHTS_OF_VERSION if since <= version)
    every = (1 << rights) - 1
    parts = [every]
    if version >= NET_VERSION:
        parts.append(0 if network else 0b11)  # to bind and to connect
    if version >= SCOPE_VERSION:
        parts.append(0b11)  # abstract sockets and signals of others
    attributes = struct.pack(f"{len(parts)}Q", *parts)
    ruleset = _checked(library.syscall(CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0), "Landlock")
    try:
        for paths, allowed in ((readable, READ_FILE | READ_DIRECTORY), (writable, every)):
            for path in paths:
                _allow(library, ruleset, path, allowed & every)
        _checked(library.syscall(RESTRICT_SELF, ruleset, 0), "Landlock")
    finally:
        os.close(ruleset)


def _allow(library: ctypes.CDLL, ruleset: int, path: Path, rights: int) -> None:
    try:
        descriptor = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:  # not here: nothing to allow
        return
    try:
        of_files = READ_FILE | WRITE_FILE | TRUNCATE
        rule = struct.pack("=Qi", rights if path.is_dir() else rights & of_files, descriptor)
        _checked(library.syscall(ADD_RULE, ruleset, BENEATH, rule, 0), f"Landlock for {path}")
    finally:
        os.close(descriptor)


def _restrict_calls(*, network: bool) -> None:
    """Let the kernel refuse every call that is not on the list."""
    program = filter_program(platform.machine(), network=network)
    code = ctypes.create_string_buffer(program)
    whole = ctypes.create_string_buffer(struct.pack("H6xP", len(program) // 8, ctypes.addressof(code)))
    library = ctypes.CDLL(None, use_errno=True)
    _checked(library.prctl(SECCOMP, FILTER, ctypes.c_void_p(ctypes.addressof(whole)), 0, 0), "seccomp")


def _checked(code: int, what: str) -> int:
    if code < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")
    return int(code)
