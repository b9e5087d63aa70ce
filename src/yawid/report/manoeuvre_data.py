"""The manoeuvres that the report draws."""

from collections.abc import Container, Sequence
from typing import Final

from yawid.answers.run_summary import Manoeuvre
from yawid.results.reasons import KINDS

MOST_DRAWN: Final = 4
"""The largest number of manoeuvres with a picture: nobody looks at a hundred pictures."""


def to_draw(manoeuvres: Sequence[Manoeuvre], used: Container[int]) -> list[Manoeuvre]:
    """Return the manoeuvres to draw, the best first.

    Those ``used`` for the flight come first, then those with fewer fatal reasons and with reasons
    further down the table of reasons. Among equals the higher simulated fit comes first, or the
    lower number where a manoeuvre is not usable.
    """
    ranks = {id_: rank for rank, id_ in enumerate(KINDS)}

    def worth(each: Manoeuvre) -> tuple[bool, tuple[int, ...], float]:
        fit = None if each.answer is None else each.answer.fit.simulation_pct
        told = each.n if fit is None or not each.verdict.usable else -fit
        fatal = [ranks.get(reason.id, 0) for reason in each.verdict.fatal]
        against = (len(fatal), *(-rank for rank in fatal))
        return each.n not in used, against, told

    return sorted((each for each in manoeuvres if each.answer is not None), key=worth)[:MOST_DRAWN]
