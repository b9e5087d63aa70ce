"""THE table of methods: what each is called, how it learns, how it is drawn, and who checks it.

A further method of a record is a file with its fit and its scores, and a row here. One that
recurses is a recursion of the kernel as well, and a name in ``config/names.py``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from yawid.blocks import Floats
from yawid.config.names import ELS, RML
from yawid.estimation.prediction_error import RecordFit, Scores


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One way to estimate theta.

    ``fit`` returns theta (n_theta,) of a record, None where it finds none; it is done where it
    gains a smaller share than the number given. ``scores`` returns what the covariance at theta is
    made of, from the residuals of each stretch there. ``filters`` says that the recursion's
    regressor is phi filtered by 1/C(q). The methods of ``checked_by`` are compared with it where it
    answers. One that ``needs_spr`` is sure to lead to the truth only where 1/C - 1/2 is positive
    real: where it is not, or where it may not be used itself, it checks nothing. ``colour`` is that
    of its lines, ``shade`` the colour in a word.
    """

    name: str
    words: str
    colour: str
    shade: str
    fit: Callable[[RecordFit, float], Floats | None]
    scores: Callable[[RecordFit, Floats, list[Floats]], Scores]
    filters: bool = False
    checked_by: tuple[str, ...] = ()
    needs_spr: bool = False


_ROWS = (
    Method(
        name=ELS, words="extended least squares", colour="#c474c6", shade="pink",
        fit=RecordFit.fixed_point, scores=RecordFit.pseudo_linear_scores,
        checked_by=(RML,), needs_spr=True,
    ),
    Method(
        name=RML, words="recursive maximum likelihood", colour="#6e45d6", shade="violet",
        fit=RecordFit.gauss_newton, scores=RecordFit.scores, filters=True, checked_by=(ELS,),
    ),
)  # fmt: skip
METHODS: Final[Mapping[str, Method]] = {row.name: row for row in _ROWS}
"""By name. Over a record the last one answers, and those before it are shown next to it."""
OF_STRUCTURES: Final = RML
"""The method by which structures are fitted to be compared: none has less loss."""


def of_a_record(asked: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the methods of a record, the one that answers first: ELS alone if it alone is asked.

    ``asked`` are those of the stream.
    """
    return asked if asked == (ELS,) else tuple(METHODS)[::-1]
