"""Gathers what a record lacks, so that one error asks for all of it at once."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from yawid.errors import ConfigError

RUDDER_UNIT: Final = {"--rudder-unit": "half-travel/rad/deg"}
SIGN: Final = {"--rudder-sign": "nose-right/nose-left"}
UNITS: Final = {"--units": "deg/rad"}
"""Options that give a fact, with the values of which the user chooses one."""


class LackingError(ConfigError):
    """A fact that neither the file nor an option gives.

    ``what`` says it in a few words; ``options`` give it; ``columns`` are parts of ``--columns``.
    """

    def __init__(
        self, said: str, what: str, options: Mapping[str, str], columns: tuple[str, ...] = ()
    ) -> None:
        super().__init__(said)
        self.what, self.options, self.columns = what, options, columns


@contextmanager
def gathered(lacking: list[LackingError]) -> Iterator[None]:
    """Keep an error about a lacking fact in a list, so that the next fact is looked at too."""
    try:
        yield
    except LackingError as error:
        lacking.append(error)


def raise_all(path: Path, lacking: list[LackingError], given: tuple[str, ...]) -> None:
    """Raise one error that asks for all lacking facts; ``given`` is what ``--columns`` has now.

    Raises:
        ConfigError: there is a lacking fact.
    """
    if len(lacking) == 1:
        raise lacking[0]
    if lacking:
        options = {name: said for each in lacking for name, said in each.options.items()}
        columns = [part for each in lacking for part in each.columns]
        named = {part.partition("=")[0]: part for part in (*given, *columns)} if columns else {}
        raise ConfigError(
            f"{path}: not given are {'; '.join(each.what for each in lacking)}: add "
            f"{line_of(list(named.values()), options)}"
        )


def line_of(columns: list[str], options: Mapping[str, str]) -> str:
    """Return options as they are typed, and what to do where one offers several values."""
    typed = [f"--columns '{','.join(columns)}'"] if columns else []
    typed += [" ".join(each) for each in options.items()]
    return " ".join(typed) + (", with one of the values at each /" if options else "")
