"""Errors in Python's words: the library's texts name options, a caller in Python has keywords."""

import re
from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Final, ParamSpec, TypeVar

from yawid.errors import YawidError, did_you_mean

P = ParamSpec("P")
T = TypeVar("T")

_OTHERS: Final = {"from": "from_s", "to": "to_s", "param": "parameters"}
"""The keywords that are not the option's name with underscores."""
_LISTED: Final = re.compile(r"--columns '([^']*)'")
_OPTION: Final = re.compile(r"(?<![\w-])--([a-z]+(?:-[a-z]+)*)")


def in_keywords(text: str) -> str:
    """Return a text with the keyword of Python instead of each option of the command line."""
    text = _LISTED.sub(lambda found: f'columns="{found[1]}"', text)
    return _OPTION.sub(lambda found: _OTHERS.get(found[1], found[1].replace("-", "_")), text)


def with_keywords(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function whose errors have Python's words, and name the keyword that was meant."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        names = signature(function).parameters
        if unknown := [name for name in kwargs if name not in names]:
            said = f"{function.__name__}() got an unexpected keyword argument {unknown[0]!r}"
            raise TypeError(said + did_you_mean(unknown[0], names))
        try:
            return function(*args, **kwargs)
        except YawidError as error:
            error.args = tuple(in_keywords(str(each)) for each in error.args)
            raise

    return called
