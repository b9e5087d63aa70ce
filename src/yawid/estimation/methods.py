"""THE table of the recursive methods: each one's name, its words, its colour, its regressor.

A new method needs a row here, a recursion in the kernel and a name in ``config/names.py``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from yawid.config.names import ELS, RML


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One way to estimate theta.

    - ``name`` on the command line and in files, ``words`` for texts;
    - ``colour`` of its lines, ``shade`` the same colour as a word;
    - ``filters``: the regressor of the recursion is phi filtered by 1/C(q).
    """

    name: str
    words: str
    colour: str
    shade: str
    filters: bool = False


_ROWS = (
    Method(name=ELS, words="extended least squares", colour="#c474c6", shade="pink"),
    Method(
        name=RML, words="recursive maximum likelihood", colour="#6e45d6", shade="violet",
        filters=True,
    ),
)  # fmt: skip
METHODS: Final[Mapping[str, Method]] = {row.name: row for row in _ROWS}
"""All methods by name."""
OF_STRUCTURES: Final = RML
"""The method with which structures are fitted to be compared: it has the smallest loss."""
