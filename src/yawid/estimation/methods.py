"""THE table of methods: each one's name, its fit, its colour, and the methods that check it.

A new method for whole records needs a file with its fit and a row here. A recursive one also needs
a recursion in the kernel and a name in ``config/names.py``.
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

    - ``name`` on the command line and in files, ``words`` for texts;
    - ``colour`` of its lines, ``shade`` the same colour as a word;
    - ``fit`` returns theta (n_theta,) for a record, None where it finds none; it stops where a step
      reduces the loss by a smaller share than its second argument;
    - ``scores`` returns the :data:`Scores` from which the covariance at theta is computed, given
      theta and the residuals of each stretch there;
    - ``filters``: the regressor of the recursion is phi filtered by 1/C(q);
    - ``checked_by``: the methods whose answers are compared with it, where its answer is given;
    - ``needs_spr``: convergence to the true theta is certain only where 1/C - 1/2 is strictly
      positive real; where it is not, or the method itself is not usable, it does not check others.
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
"""All methods by name. The last one answers for a record; the others are shown next to it."""
OF_STRUCTURES: Final = RML
"""The method with which structures are fitted to be compared: it has the smallest loss."""


def of_a_record(asked: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the methods for a record, the one that answers first.

    ``asked`` are the methods of the stream: where ELS is the only one, it is so for records too.
    """
    return asked if asked == (ELS,) else tuple(METHODS)[::-1]
