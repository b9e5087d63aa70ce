"""Processes: their groups, signals, priority and end with the parent; cores and a steady clock."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

OWN_GROUP: Final = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)
"""``creationflags`` of a process that a Ctrl-C in Windows' console must not reach."""
HERE: Final = "127.0.0.1"
"""The address of this machine that no other machine reaches."""
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
_STEADY = getattr(time, "CLOCK_BOOTTIME", getattr(time, "CLOCK_MONOTONIC", 0))
_MOST_PROCESSES = 60  # Windows waits for 63 at a time


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


def has_desktop() -> bool:
    """Return whether a page can be opened in a browser with windows, not in the terminal."""
    shown = {"DISPLAY", "WAYLAND_DISPLAY", "BROWSER"}
    return sys.platform in ("win32", "darwin") or not shown.isdisjoint(os.environ)


def steady_ns() -> int:
    """Return the time of a clock that never steps, and where possible counts suspended time."""
    if sys.platform == "win32":
        return time.perf_counter_ns()  # there monotonic_ns goes in steps of 16 ms
    return time.clock_gettime_ns(_STEADY)


def show_escapes() -> None:
    """Have a console of Windows show escape sequences: any command of its shell sets it so."""
    if sys.platform == "win32":
        os.system("")
