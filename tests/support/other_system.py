"""Another operating system, as far as yawid's own files can see: a stand-in, not the real one.

Every Python process of :func:`environment` shows them the modules and names of that system only.
Libraries, and Python itself, still see Linux. It is put on the path as ``sitecustomize``.
"""

from __future__ import annotations

import builtins
import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

PLATFORM = "YAWID_TEST_PLATFORM"
NO_MODULES = {
    "win32": {"fcntl", "termios", "tty", "pty", "resource", "pwd", "grp"},
    "darwin": set(),
}
NO_NAMES: dict[str, dict[str, set[str]]] = {
    "darwin": {
        "os": {"sched_getaffinity", "sched_setaffinity", "pidfd_open", "memfd_create"},
        "time": {"CLOCK_BOOTTIME"},
        "signal": {"SIGSTKFLT", "SIGPWR"},
    },
    "win32": {
        "os": {
            "geteuid", "getuid", "getgid", "getegid", "fork", "nice", "killpg", "setsid", "getpgid",
            "sched_getaffinity", "sched_setaffinity", "sysconf", "mkfifo", "chown", "fchown",
            "fchmod", "openpty", "statvfs", "uname", "set_blocking", "wait", "O_NOFOLLOW",
            "O_CLOEXEC", "O_NONBLOCK", "O_NOCTTY", "O_DIRECTORY", "O_SYNC", "WNOHANG",
        },
        "time": {"CLOCK_BOOTTIME", "CLOCK_MONOTONIC", "CLOCK_REALTIME", "clock_gettime",
                 "clock_gettime_ns", "pthread_getcpuclockid", "tzset"},
        "signal": {"SIGKILL", "SIGHUP", "SIGQUIT", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGTSTP",
                   "SIGCONT", "SIGCHLD", "SIGPIPE", "SIGWINCH", "SIG_BLOCK", "SIG_SETMASK",
                   "pthread_sigmask", "alarm", "setitimer", "sigwait", "pause", "siginterrupt"},
        "socket": {"MSG_DONTWAIT", "AF_UNIX", "SO_REUSEPORT", "CMSG_LEN", "socketpair"},
        "mmap": {"MAP_PRIVATE", "MAP_ANONYMOUS", "MAP_SHARED", "PROT_READ", "PROT_WRITE"},
    },
}  # fmt: skip


def environment(folder: Path, platform: str) -> dict[str, str]:
    """Return variables that make every Python process below look like ``win32`` or ``darwin``."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(__file__, folder / "sitecustomize.py")
    before = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([str(folder), *([before] if before else [])])
    return os.environ | {"PYTHONPATH": path, PLATFORM: platform}


class _View(ModuleType):
    """A module without some names, and with others of its own; what is set goes to the module."""

    def __init__(self, module: ModuleType, hidden: set[str], own: Mapping[str, Any]) -> None:
        super().__init__(module.__name__)
        self.__dict__.update(_module=module, _hidden=hidden, _own=own)

    def __getattr__(self, name: str) -> Any:
        if name in self._hidden:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return self._own[name] if name in self._own else getattr(self._module, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._module, name, value)


def _own_names(platform: str) -> dict[str, dict[str, Any]]:
    own: dict[str, dict[str, Any]] = {"sys": {"platform": platform}}
    if platform == "win32":
        kernel = SimpleNamespace(GetStdHandle=abs, GetConsoleMode=lambda *_: 0)  # no console
        own |= {"os": {"name": "nt", "O_BINARY": 0}, "socket": {"socket": _windows_socket()}}
        own["ctypes"] = {"windll": SimpleNamespace(kernel32=kernel)}
    return own


def _windows_socket() -> type:
    import socket
    import struct

    class Socket(socket.socket):
        """A socket whose time-out is set in ms, and that cannot be bound to a group's address."""

        def setsockopt(self, level: int, option: int, value: Any) -> None:  # type: ignore[override] # of four forms this one is used
            if option == socket.SO_RCVTIMEO:
                (ms,) = struct.unpack("@I", value)
                value = struct.pack("@ll", ms // 1000, ms % 1000 * 1000)
            super().setsockopt(level, option, value)

        def bind(self, address: Any) -> None:
            if address[0].startswith("239."):
                raise OSError(10049, "WSAEADDRNOTAVAIL")
            super().bind(address)

        def recvfrom(self, size: int, flags: int = 0) -> Any:
            try:
                return super().recvfrom(size, flags)
            except ConnectionRefusedError as error:
                raise ConnectionResetError(10054, "WSAECONNRESET") from error
            except BlockingIOError as error:
                raise TimeoutError(10060, "WSAETIMEDOUT") from error

    return Socket


def _msvcrt() -> ModuleType:
    import fcntl

    module = ModuleType("msvcrt")

    def locking(descriptor: int, mode: int, size: int) -> None:
        assert (mode, size) == (2, 1)
        assert os.lseek(descriptor, 0, os.SEEK_CUR) > 2e9  # a byte that nobody reads
        fcntl.flock(
            descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB
        )  # lockf has no locks within a process

    module.__dict__.update(LK_NBLCK=2, locking=locking)
    return module


def _refuse_open_files(event: str, arguments: Any) -> None:
    """Refuse what Windows does: to rename or remove a file that this process has open."""
    if event not in {"os.rename", "os.remove"}:
        return
    paths = {Path(each).resolve() for each in arguments[:2] if isinstance(each, str | os.PathLike)}
    for descriptor in Path("/proc/self/fd").iterdir():
        if descriptor.is_symlink() and (name := descriptor.readlink()) in paths:
            raise PermissionError(13, "the file is used by this process (WinError 32)", str(name))


def _put_on(platform: str) -> None:
    """Have import statements in yawid's files give views."""
    import subprocess  # noqa: F401 # it must not find msvcrt

    if platform == "win32":
        sys.addaudithook(_refuse_open_files)
    no_modules, no_names, own = NO_MODULES[platform], NO_NAMES[platform], _own_names(platform)
    views: dict[str, ModuleType] = {"msvcrt": _msvcrt()} if platform == "win32" else {}
    real = builtins.__import__

    def imported(name: str, given: Any = None, *rest: Any, **more: Any) -> Any:
        if not (given and str(given.get("__package__")).partition(".")[0] == "yawid"):
            return real(name, given, *rest, **more)
        if name in no_modules:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        if name in views:
            return views[name]
        module = real(name, given, *rest, **more)
        if name in no_names or name in own:
            hidden = no_names.get(name, set())
            views[name] = module = _View(module, hidden, own.get(name, {}))
        return module

    builtins.__import__ = imported


if __name__ == "sitecustomize" and PLATFORM in os.environ:
    _put_on(os.environ[PLATFORM])
