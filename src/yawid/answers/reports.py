"""The answers of commands without a summary, as ``--json`` prints them: orders and step.

As in a summary, what does not apply is None and has no key.
"""

from typing import Annotated, Final

from yawid.answers.part import Count, Number, Part, named, says
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import DutchRoll, Orders


class OrdersTried(Orders, frozen=True, kw_only=True):
    """One structure and its scores: fitted to two thirds of the record, run free over the rest.

    The sigmas of its Dutch roll are of noise alone.
    """

    loss: Annotated[
        Number | None, says("mean square innovation over the samples used", "(rad/s)^2")
    ] = None
    aic: Annotated[Number | None, says("Akaike's criterion, less is better", "1")] = None
    bic: Annotated[Number | None, says("Schwarz's criterion, less is better", "1")] = None
    whiteness_p: Number | None = None
    simulation_pct: Annotated[
        Number | None, says("run free over the last third, which it has not seen", "%")
    ] = None
    dutch_roll: Annotated[
        DutchRoll | None,
        says("the answer, or what a method found; absent where no mode of the model is one"),
    ] = None


class OrdersReport(Part, frozen=True, kw_only=True):
    """The result of ``yawid orders``: every structure, the best first, and the recommended one.

    The verdict is that of a replay; ``recommended`` is None where that is not usable. The samples
    are those of ``manoeuvres`` manoeuvres, or of the whole log where it is 0.
    """

    log: Annotated[
        str, says("absolute path of the log, or the endpoint of a live session without a tlog")
    ]
    manoeuvres: Annotated[Count, says("those whose samples were compared; 0: all of the log")]
    recommended: Annotated[
        Orders | None, says("the structure to use; absent where no replay can be used")
    ] = None
    candidates: Annotated[list[OrdersTried], says("every structure tried, best simulation first")]
    verdict: Annotated[
        Verdict, says("the flight's, or why the log has no answer; absent where nothing was judged")
    ]


class Told(Part, frozen=True, kw_only=True):
    """A number of a step response and its sigma."""

    value: Annotated[Number, says("the number", "as the quantity it belongs to")]
    std: Annotated[Number, says("its sigma, in the same unit", "as the quantity it belongs to")]


OF_STEP: Final = {
    "K": "steady gain",
    "T": "time constant, s",
    "k": "steady gain",
    "D": "damping ratio",
    "q": "natural frequency, rad/s",
}
"""The numbers of a first and of a second order."""


class StepReport(Part, frozen=True, kw_only=True):
    """The result of ``yawid step``: the form of the step response, its parameters and times.

    ``formula`` has the parameters as the paper's eq. 5-6 or 14-16 read them off the record.
    """

    model: Annotated[
        str,
        says(
            "first or second order (eq. 4, 7), or the yaw rate of eq. 23",
            enum=["first", "second", "yaw"],
        ),
    ]
    parameters: Annotated[
        dict[str, Told],
        says(
            "K, T of the first order; k, D, q of the second; eq. 23's of the yaw rate",
            **named(
                **OF_STEP,
                T_theta_s="time constant of the zero, s",
                xi_beta="damping ratio",
                omega_beta="natural frequency, rad/s",
            ),
        ),
    ]
    formula: Annotated[
        dict[str, Number] | None,
        says(
            "the same, as the paper's formulas read them off the record (eq. 5-6, 14-16)",
            **named(**OF_STEP),
        ),
    ] = None
    settling_2pct_s: Annotated[Told, says("time after which it stays within 2 % of its end", "s")]
    settling_5pct_s: Annotated[Told, says("time after which it stays within 5 % of its end", "s")]
    noise_std: Annotated[Number, says("of the record about the model, in its own unit", "of y")]
