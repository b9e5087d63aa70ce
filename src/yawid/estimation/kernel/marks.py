"""What the compiler is to do with a function of the kernel; as plain Python it stays as it is."""

from typing import Any

MARKS: dict[Any, dict[str, Any]] = {}
"""Marked function -> options of numba's ``njit``."""


def hot(function: Any) -> Any:
    """Compile into each caller: for what runs at every sample, where calls cost most."""
    MARKS[function] = {"forceinline": True}
    return function


def merged(function: Any) -> Any:
    """Let numba write it into its one caller, for what is long and would else be compiled twice.

    For what is short :func:`hot` costs less: numba copies the caller for each.
    """
    MARKS[function] = {"inline": "always"}
    return function


def called(function: Any) -> Any:
    """Compile as a function of its own: what is rare, or stands beside the samples' way."""
    MARKS[function] = {}
    return function
