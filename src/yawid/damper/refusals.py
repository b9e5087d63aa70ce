"""Why a run gives no advice on its damper: what must be known, each check with what to do."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import isfinite, pi
from typing import TYPE_CHECKING, Final

import numpy as np

from yawid.answers.heard import gains_between
from yawid.answers.more_manoeuvres import MORE, of_mean
from yawid.answers.reasons import Reason
from yawid.answers.run_summary import Flight, Manoeuvre, RunSummary
from yawid.config.run import RunConfig
from yawid.damper.autopilots import AUTOPILOTS, Autopilot, first
from yawid.quantities.vehicles import AIRFRAME

if TYPE_CHECKING:
    from yawid.models.flown import Flown  # it takes long to load, and inspect needs none of it

EXIT_CODES: Final = {
    "not_usable": 5, "stick": 5, "other_loop": 5, "airspeed_unknown": 5, "wn_uncertain": 5,
    "gain_uncertain": 5, "roll_term": 5, "not_fitted": 5, "no_autopilot": 2, "loop_rate_unknown": 2,
    "parameters_unknown": 2, "travel_unknown": 2, "too_far": 2,
}  # fmt: skip
"""The exit code of each reason for refusing."""
OF_DAMPER: Final = (*EXIT_CODES, "lowers_damping", "gain_changed", "airframe_differs")
"""The reasons that only this report has; ``closed_loop`` is one of a replay, too."""
MOST_WN_STD, MOST_GAIN_STD, MOST_TURN = 0.05, 0.2, 0.2
"""The largest sigma of wn and of the gain at wn, and the largest share of the turn's term."""
NEAR_WN: Final = (0.7, 1.4)
"""The frequencies, over wn, at which the turn's term is compared with the yaw rate."""
CARD: Final = "fly more manoeuvres at this airspeed: yawid inspect LOG --card says which"
Falls = Callable[[int], float | None]
"""Returns a sigma, as a part of its number, after so many more manoeuvres; None if unknown."""


class Refused(Exception):  # noqa: N818  it names a finding, not a fault
    """The reason for giving no advice, and what to do about it."""

    def __init__(self, id_: str, text: str, to_do: str) -> None:
        super().__init__(text)
        self.reason = Reason(id_, text, weight="fatal")
        self.to_do = to_do


def usable_flight(summary: RunSummary) -> Flight:
    """Return the flight's answer.

    Raises:
        Refused: it is not usable.
    """
    flight = summary.flight
    if flight is None or flight.dutch_roll is None or not flight.verdict.usable:
        fatal = summary.deciding.fatal
        why = ", ".join(reason.name for reason in fatal) or "no manoeuvre was found"
        text = f"the log has no usable answer of a flight ({why})"
        raise Refused("not_usable", text, summary.deciding.next or CARD)
    return flight


def check_known(flight: Flight, most_wn_std: float = MOST_WN_STD) -> None:
    """Check that a usable flight has a known airspeed, and a wn that is known well enough.

    Raises:
        Refused: it has not.
    """

    def part_after(more: int) -> float | None:
        roll = of_mean(flight, more).dutch_roll
        return None if roll is None or roll.wn_std is None else roll.wn_std / roll.wn_rad_s

    check_sigma("wn_uncertain", "wn", part_after, most_wn_std)
    if flight.airspeed_m_s is None or flight.airspeed_source != "airspeed":
        text = "the airspeed of the manoeuvres is not known, and the damper is scaled by it"
        raise Refused("airspeed_unknown", text, "fly with an airspeed in the log")


def check_sigma(id_: str, what: str, falls: Falls, most: float) -> None:
    """Check that the sigma of ``what`` is at most ``most``, a part of it; ``falls(0)`` is today's.

    Raises:
        Refused: it is not, or not known.
    """
    if (part := falls(0)) is None or not part <= most:
        known = "no sigma" if part is None else f"a sigma of {percent(part)} %"
        text = f"{what} has {known}, and at most {100 * most:g} % is needed"
        raise Refused(id_, text, fly_more(falls, most))


def fly_more(falls: Falls, most: float) -> str:
    """Return whether more manoeuvres would bring a sigma to ``most``, and what to do."""
    for more in MORE:
        if (std := falls(more)) is not None and std <= most:
            return f"{CARD}; {more} more should bring this sigma to {percent(std)} %"
    if std is None:
        return CARD
    left = f"{more} more manoeuvres like these would leave this sigma at {percent(std)} %"
    return f"{left}: keep the gain that was flown"


def percent(part: float) -> str:
    """Return a sigma in percent, rounded up to a tenth, so that it never seems to pass a limit."""
    return f"{np.ceil(1e3 * part) / 10:g}"


def autopilot_of(summary: RunSummary, name: str | None) -> Autopilot:
    """Return the autopilot of the log, or the one named.

    Raises:
        Refused: its damper is not known.
    """
    vehicle = summary.vehicle
    number = None if vehicle is None else vehicle.autopilot
    for row in AUTOPILOTS.values():
        if name == row.name or (name is None and number == row.number):
            return row
    found = "names no autopilot" if vehicle is None else f"is of {vehicle.autopilot_name}"
    text = f"the log {found}, and only the dampers of ArduPlane and PX4 are known"
    raise Refused("no_autopilot", text, "name the autopilot: --autopilot ardupilot or px4")


def check_input(summary: RunSummary, config: RunConfig) -> None:
    """Check that the input is the command of the servo, in a known part of its travel.

    Raises:
        Refused: the input is the stick: its answer has the damper in it; or the travel is unknown.
    """
    rudder = summary.channels.get("rudder")
    stands_in = any(reason.id == "channel_stand_in" for reason in summary.deciding.reasons)
    if stands_in or (rudder is not None and rudder.source.startswith("RC_CHANNELS")):
        text = "the input is the pilot's stick: such an answer is that of the damped aircraft"
        raise Refused("stick", text, "log the servo outputs and fly again")
    if config.unit_of_rudder == "rad" and config.rudder_max_deg is None:
        text = "the rudder is in rad and its travel, of which a damper moves parts, is not known"
        raise Refused("travel_unknown", text, "replay with --rudder-max-deg D")


def check_loop(autopilot: Autopilot, known: Mapping[str, float]) -> None:
    """Check that the damper can be modelled, and that its rate and parameters are known.

    Raises:
        Refused: they are not; the text names what is missing and how to give it.
    """
    if (against := autopilot.against(known)) is not None:
        raise Refused("other_loop", against, "set it so, and fly again")
    missing = [names[0] for names in autopilot.needs(known) if first(known, names) is None]
    names, give = ", ".join(missing), [f"--param {name}=VALUE" for name in missing]
    id_, text = "parameters_unknown", f"not in the log: {names}"
    loop_hz = known.get(autopilot.loop_rate, 0.0)
    if not (isfinite(loop_hz) and loop_hz > 0.0):
        id_, give = "loop_rate_unknown", [f"--param {autopilot.loop_rate}=HZ", *give]
        text = f"{autopilot.loop_rate} is not in the log: delay and washout depend on it"
        text += f"; nor are {names}" if missing else ""
    if give:
        raise Refused(id_, text, f"give {' '.join(give)}, or log all parameters")


def refusals(
    summary: RunSummary, config: RunConfig, known: Mapping[str, float]
) -> Iterator[Refused]:
    """Yield what stops the advice before anything is predicted, for the parameters ``known``."""
    checks: tuple[Callable[[], None], ...] = (
        lambda: check_known(usable_flight(summary)),
        lambda: check_input(summary, config),
        lambda: check_loop(autopilot_of(summary, None), known),
    )
    for check in checks:
        try:
            check()
        except Refused as refused:
            yield refused


def gain_flown(summary: RunSummary, manoeuvre: Manoeuvre, name: str, last: float) -> float | None:
    """Return the value that a gain had in a manoeuvre, None where it changed in the midst of it.

    Where only the sticks move the surfaces no damper acts, and its gain is 0. ``last`` is the
    parameter's last value in the log.
    """
    if manoeuvre.loop == AIRFRAME:
        return 0.0
    rudder = summary.channels.get("rudder")
    seen = [each for each in (rudder and rudder.yaw_gains) or () if each.name == name]
    quarter = 0.25 * (manoeuvre.to_s - manoeuvre.from_s)
    inner = manoeuvre.from_s + quarter, manoeuvre.to_s - quarter
    values = set(gains_between(seen, summary.boots, *inner).get(name, [last]))
    return values.pop() if len(values) == 1 else None


def check_turn(flown: Sequence["Flown"], wn: float, factor: float) -> None:
    """Check the share of the turn's term, which feeds the roll back, in the yaw rate near wn.

    ``factor`` is the parameter of the term, wn is in rad/s.

    Raises:
        Refused: it is above 20 %, or the bank is not known.
    """
    from scipy.signal import periodogram  # takes long to load, and every command reads this file

    total = np.zeros(2)
    for each in flown:
        good = np.isfinite(each.y) & np.isfinite(each.turn_rate)
        if np.count_nonzero(good) < len(good) / 2:
            text = "bank or airspeed is not known: the damper also feeds back the wanted turn"
            raise Refused("roll_term", text, "log ATTITUDE and the airspeed")
        t = np.arange(len(good))
        whole = [np.interp(t, t[good], x[good]) for x in (each.y, factor * each.turn_rate)]
        w, power = periodogram(whole, 2.0 * pi / each.sample_time_s, "hann")
        total += power[:, (w >= NEAR_WN[0] * wn) & (w <= NEAR_WN[1] * wn)].sum(axis=1)
    share = float(np.sqrt(total[1] / total[0])) if total[0] > 0.0 else np.inf
    if share > MOST_TURN:
        text = (
            f"near wn the wanted turn that the damper subtracts is {100 * share:.0f} % of the yaw "
            f"rate: at most {100 * MOST_TURN:g} % can be trusted in the loop"
        )
        raise Refused("roll_term", text, "hold the roll more closely in the manoeuvres")
