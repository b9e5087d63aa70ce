"""What Windows and macOS lack or do differently: all other files ask here, and run on all three."""

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

OWN_GROUP: Final = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
"""``creationflags`` of a process that a Ctrl-C in Windows' console must not reach."""
SAFE_OPEN: Final = sum(
    getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK", "O_BINARY")
)
"""Flags that open a regular file, unchanged, without following a link or waiting for a pipe."""
HAS_DESCRIPTOR_NAMES: Final = sys.platform != "win32"
"""Whether ``/dev/fd/N`` opens the descriptor N."""
_DIE_WITH_PARENT, _FOR_OTHERS = 1, stat.S_IWGRP | stat.S_IWOTH  # PR_SET_PDEATHSIG of prctl(2)
_STEADY = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", 0))
_MOST_PROCESSES = 60  # Windows waits for 63 at a time


def lock(descriptor: int) -> None:
    """Lock an open file, which no other process has then, until it is closed or the process ends.

    Raises:
        OSError: another process has locked it.
    """
    if sys.platform == "win32":
        import msvcrt

        os.lseek(descriptor, 0, os.SEEK_SET)  # the lock is that of the first byte
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def who_else_writes(
    path: Path, about: os.stat_result | None, *, is_above: bool = False
) -> str | None:
    """Return in words who else could change a file or folder, or one below it; None: nobody.

    ``about`` is None where it does not exist yet. Where ``is_above`` is set, only what this user
    makes below ``path`` has to be safe. On Windows ``about`` does not show who may write, so only
    the user's own folder is trusted.
    """
    if sys.platform == "win32":
        home = Path(os.path.realpath(Path.home()))
        is_own = path.is_relative_to(home) or (is_above and home.is_relative_to(path))
        return None if is_own else f"{path} is not in your own folder {home}"
    if about is None:
        return None
    if about.st_uid not in (0, os.geteuid()):
        return f"{path} belongs to user {about.st_uid}"
    # Where the sticky bit is set, a user cannot rename files of another user.
    if about.st_mode & _FOR_OTHERS and not (is_above and about.st_mode & stat.S_ISVTX):
        return f"{path} can be written to by others"
    return None


def die_with_parent() -> None:
    """Have Linux kill this process when its parent ends, and choose it when memory runs out."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
        with suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


def block(signals: Sequence[signal.Signals]) -> None:
    """Have no signal of these reach this thread and its processes; on Windows none reaches it."""
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_BLOCK, signals)


def run_last() -> None:
    """Let all other processes run first, where the system can do that."""
    if sys.platform != "win32":
        os.nice(19)


def cores() -> int:
    """Return how many cores this process may use."""
    if sys.platform != "linux":
        return min(os.cpu_count() or 1, _MOST_PROCESSES)
    else:  # noqa: RET505 # without it mypy finds the line unreachable
        return len(os.sched_getaffinity(0))


def steady_ns() -> int:
    """Return the time of a clock that never steps, and where possible counts suspended time."""
    if sys.platform == "win32":
        return time.perf_counter_ns()  # there monotonic_ns goes in steps of 16 ms
    return time.clock_gettime_ns(_STEADY)
