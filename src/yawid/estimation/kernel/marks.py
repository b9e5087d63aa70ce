"""Marks for the compiler: how to compile a function of the kernel; plain Python ignores them."""

from typing import Any

MARKS: dict[Any, dict[str, Any]] = {}
"""Options of numba's ``njit`` by marked function."""


def hot(function: Any) -> Any:
    """Compile the function into each caller: for what runs at every sample, where calls cost."""
    MARKS[function] = {"forceinline": True}
    return function


def merged(function: Any) -> Any:
    """Let numba copy the function into its only caller: for long ones, else compiled twice.

    For short functions :func:`hot` compiles faster: here numba copies the caller each time.
    """
    MARKS[function] = {"inline": "always"}
    return function


def called(function: Any) -> Any:
    """Compile the function on its own: for what does not run at every sample of the recursion."""
    MARKS[function] = {}
    return function
