"""The manoeuvres that the report draws."""

from collections.abc import Container, Sequence
from typing import Final

from yawid.answers.run_summary import Manoeuvre

MOST_DRAWN: Final = 4
"""The largest number of manoeuvres with a picture: nobody looks at a hundred pictures."""


def to_draw(manoeuvres: Sequence[Manoeuvre], used: Container[int]) -> list[Manoeuvre]:
    """Return the manoeuvres to draw, the best first.

    Those ``used`` for the flight come first, then other usable ones, those of a higher simulated
    fit first; then refused ones by their standing.
    """

    def worth(each: Manoeuvre) -> tuple[bool, tuple[float, float]]:
        answer = each.answer if each.verdict.usable else None
        fit = None if answer is None else answer.fit.simulation_pct
        return each.n not in used, each.standing if fit is None else (0, -fit)

    return sorted((each for each in manoeuvres if each.answer is not None), key=worth)[:MOST_DRAWN]
