"""Errors in Python's words: the library's texts name options, a caller in Python has keywords."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from yawid.errors import YawidError

_OTHERS: Final = {"from": "from_s", "to": "to_s", "param": "parameters"}
"""The keywords that are not the option's name with underscores."""
_LISTED: Final = re.compile(r"--columns '([^']*)'")
_OPTION: Final = re.compile(r"(?<![\w-])--([a-z]+(?:-[a-z]+)*)")


def in_keywords(text: str) -> str:
    """Return a text with the keyword of Python instead of each option of the command line."""
    text = _LISTED.sub(lambda found: f'columns="{found[1]}"', text)
    return _OPTION.sub(lambda found: _OTHERS.get(found[1], found[1].replace("-", "_")), text)


@contextmanager
def errors_in_keywords() -> Iterator[None]:
    """Give the errors that yawid raises on purpose the names that Python has for its options."""
    try:
        yield
    except YawidError as error:
        error.args = tuple(in_keywords(str(each)) for each in error.args)
        raise
