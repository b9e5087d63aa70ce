"""Another operating system, as far as yawid's own files can see: a stand-in, not the real one.

Every Python process of :func:`environment` shows them the modules and names of that system only.
Libraries, and Python itself, still see Linux. It is put on the path as ``sitecustomize``.
"""

from __future__ import annotations

import builtins
import os
import shutil
import socket
import struct
import sys
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


class Socket(socket.socket):
    """A socket of Windows: its time-out is in ms, and no group's address can be bound."""

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


def _locking(descriptor: int, mode: int, size: int) -> None:
    import fcntl

    assert (mode, size) == (2, 1)
    assert os.lseek(descriptor, 0, os.SEEK_CUR) > 2e9  # a byte that is not read
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # lockf has no locks within a process


NO_CONSOLE = SimpleNamespace(GetStdHandle=abs, GetConsoleMode=lambda *_: 0)
OWN: dict[str, dict[str, dict[str, Any]]] = {
    "darwin": {"sys": {"platform": "darwin"}},
    "win32": {
        "sys": {"platform": "win32"},
        "os": {"name": "nt", "O_BINARY": 0},
        "socket": {"socket": Socket},
        "ctypes": {"windll": SimpleNamespace(kernel32=NO_CONSOLE)},
        "msvcrt": {"LK_NBLCK": 2, "locking": _locking},
    },
}
"""Names that a module has there and not here, or that mean something else."""


def _view(name: str, platform: str, module: Any) -> ModuleType:
    """Return a module as it is there: without some names, and with others of its own."""
    view, hidden = ModuleType(name), NO_NAMES[platform].get(name, set())

    def other(wanted: str) -> Any:
        if wanted in hidden:
            raise AttributeError(f"module {name!r} has no attribute {wanted!r}")
        return getattr(module, wanted)

    view.__dict__.update(OWN[platform].get(name, {}), __getattr__=other)
    return view


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
    if platform == "win32":
        sys.addaudithook(_refuse_open_files)
    changed, real, views = OWN[platform] | NO_NAMES[platform], builtins.__import__, {}

    def imported(name: str, given: Any = None, *rest: Any, **more: Any) -> Any:
        if not (given and str(given.get("__package__")).partition(".")[0] == "yawid"):
            return real(name, given, *rest, **more)
        if name in NO_MODULES[platform]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        if name not in changed:
            return real(name, given, *rest, **more)
        if name not in views:
            module = None if name == "msvcrt" else real(name, given, *rest, **more)
            views[name] = _view(name, platform, module)
        return views[name]

    builtins.__import__ = imported


if __name__ == "sitecustomize" and PLATFORM in os.environ:
    _put_on(os.environ[PLATFORM])
