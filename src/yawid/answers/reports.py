"""The answers of commands without a summary, as ``--json`` prints them: orders and step.

As in a summary, what does not apply is None and has no key.
"""

from yawid.answers.part import Count, Number, Part
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import DutchRoll, Orders


class OrdersTried(Orders, frozen=True, kw_only=True):
    """One structure and its scores: fitted to two thirds of the record, run free over the rest.

    The sigmas of its Dutch roll are of noise alone.
    """

    loss: Number | None = None
    aic: Number | None = None
    bic: Number | None = None
    whiteness_p: Number | None = None
    simulation_pct: Number | None = None
    dutch_roll: DutchRoll | None = None


class OrdersReport(Part, frozen=True, kw_only=True):
    """The result of ``yawid orders``: every structure, the best first, and the recommended one.

    The verdict is that of a replay; ``recommended`` is None where that is not usable. The samples
    are those of ``manoeuvres`` manoeuvres, or of the whole log where it is 0.
    """

    log: str
    manoeuvres: Count
    recommended: Orders | None = None
    candidates: list[OrdersTried]
    verdict: Verdict


class Told(Part, frozen=True, kw_only=True):
    """A number of a step response and its sigma."""

    value: Number
    std: Number


class StepReport(Part, frozen=True, kw_only=True):
    """The result of ``yawid step``: the form of the step response, its parameters and times.

    ``formula`` has the parameters as the paper's eq. 5-6 or 14-16 read them off the record.
    """

    model: str
    parameters: dict[str, Told]
    formula: dict[str, Number] | None = None
    settling_2pct_s: Told
    settling_5pct_s: Told
    noise_std: Number
