"""THE table of methods: each one's name, its fit, its colour, and the methods that check it.

A new method for whole records needs a file with its fit and a row here. A recursive one also needs
a recursion in the kernel and a name in ``config/names.py``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from yawid.blocks import Floats
from yawid.config.names import ELS, OE, RML
from yawid.estimation.free_run import (
    free_run_residuals,
    output_error,
    output_error_scores,
)
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
    - ``residuals`` returns the errors of each stretch at theta whose squares the fit minimises;
    - ``filters``: the regressor of the recursion is phi filtered by 1/C(q);
    - ``checked_by``: the methods whose answers are compared with it, where its answer is given;
    - ``needs_spr``: convergence to the true theta is certain only where 1/C - 1/2 is strictly
      positive real; where it is not, or the method itself is not usable, it does not check others;
    - ``runs_free``: its errors are those of a free run, so it is fitted, and then answers, only in
      calm air.
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
    residuals: Callable[[RecordFit, Floats], list[Floats]] = RecordFit.residuals
    runs_free: bool = False


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
    Method(
        name=OE, words="output error", colour="#446688", shade="steel blue", fit=output_error,
        scores=output_error_scores, residuals=free_run_residuals, runs_free=True,
    ),
)  # fmt: skip
METHODS: Final[Mapping[str, Method]] = {row.name: row for row in _ROWS}
"""All methods by name. The last one that is allowed answers for a record, with the others shown."""
IN_CALM_AIR: Final = next(name for name, row in METHODS.items() if row.runs_free)
OF_STRUCTURES: Final = RML
"""The method with which structures are fitted to be compared: it has the smallest loss."""


def of_a_record(asked: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return the methods for a record in any air, the one that answers first.

    ``asked`` are the methods of the stream: where ELS is the only one, it is so for records too.
    """
    if asked == (ELS,):
        return asked
    return tuple(name for name, row in METHODS.items() if not row.runs_free)[::-1]
