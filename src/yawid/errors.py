"""The exceptions that yawid raises on purpose, with exit codes; only ``cli/`` prints them."""

import importlib
from collections.abc import Iterable
from typing import Any, Final

UNFORESEEN: Final = 70
EXIT_CODES: Final = {
    0: "good: the answer may be used; there may be warnings",
    2: "usage or configuration: nothing was run",
    3: "no vehicle, no rudder or no yaw rate in the log",
    4: "the message rate is too low for an answer",
    5: "not excited or not identifiable: the answer is shown and marked unusable; trend, diff: "
    "nothing could be judged",
    6: "input or output failed",
    7: "something changed: trend, diff",
    UNFORESEEN: "unforeseen: a fault of yawid; YAWID_DEBUG=1 shows where",
    130: "interrupted by SIGINT",
    143: "interrupted by SIGTERM",
}
"""The exit codes in words; with several logs, the highest code counts."""


class YawidError(Exception):
    """The base of all errors that yawid raises about its input, its output or its use."""

    exit_code = 6


class ConfigError(YawidError, ValueError):
    """A setting outside its limits; the message names the value and the limit."""

    exit_code = 2


class SourceError(YawidError):
    """A log or a link that cannot be read."""


class ChannelError(YawidError):
    """A channel that cannot be made from the messages or columns there are."""

    exit_code = 3


class SinkError(YawidError):
    """A file or viewer that cannot be written."""


class UnwrittenError(SinkError):
    """A run that has an answer, a ``RunSummary``, which could not be written."""

    def __init__(self, text: str, summary: Any) -> None:
        super().__init__(text)
        self.summary = summary


class CompilerError(YawidError):
    """The estimators cannot be compiled here; they run as plain Python."""


class NotIdentifiable(YawidError):  # noqa: N818 it names a finding, not a fault
    """A record without an answer: it has not the form asked for, or shows too little of it."""

    exit_code = 5


def without_viewer(error: BaseException) -> str | None:
    """Return in words that rerun-sdk, or the pyarrow it brings, is missing, if that is the error.

    A companion computer may do without both.
    """
    name = str(getattr(error, "name", None)).partition(".")[0]
    if not isinstance(error, ModuleNotFoundError) or name not in ("rerun", "rerun_cli", "pyarrow"):
        return None
    return (
        f"{name} is not installed here: it is needed for the viewer, Parquet and data sets: "
        "pip install rerun-sdk, which has the viewer and brings pyarrow"
    )


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return "; did you mean X?" with the one of ``names`` that is most like ``name``, else ""."""
    from difflib import get_close_matches  # only an error needs it

    by_plain = {each.lower().replace("_", "-"): each for each in names}
    near = get_close_matches(name.lower().replace("_", "-"), by_plain, n=1, cutoff=0.6)
    return f"; did you mean {by_plain[near[0]]}?" if near else ""


def library(name: str) -> Any:
    """Import an optional library.

    Raises:
        ConfigError: it is not installed; the message names it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ConfigError(f"to_{name} needs {name}: pip install {name} ({error})") from error
