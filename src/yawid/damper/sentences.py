"""What the predictions of a damper say to the pilot, in sentences and warnings."""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from yawid.answers.damper_report import Recommended
from yawid.answers.reasons import Reason
from yawid.damper.advice import SURE, Closed, Predicted, aimed

MOSTLY_FEEDBACK: Final = 1.2
"""With a larger |L(j wn)| the rudder moves mostly by feedback; there answers were 9 to 12 % off."""
PREDICTION: Final = (
    "This is a prediction: fly it in steps, at a safe height, ready to set the old value again."
)


class Without(NamedTuple):
    """In words how far above the aim zeta is without a damper, and whether none is needed.

    There are no words where it is not above the aim, or where nothing is known.
    """

    text: str = ""
    suffices: bool = False


def without_damper(zeta: float, std: float | None, aim: float | None) -> Without:
    """Return how far above the aim zeta is without a damper; no text where it is not above it.

    ``std`` is the sigma of the mean. No damper is needed where zeta is above the aim with 95 %.
    """
    low, high = aimed(aim)
    above = zeta - high
    if above <= 0.0:
        return Without()
    sigmas = above / std if std else 0.0
    known = f"{zeta:.2f} ± {std:.2f}" if std else f"{zeta:.2f}, of unknown sigma"
    by = f"{sigmas:.1f} sigma above the aim of {low:g} to {high:g}"
    if sigmas >= SURE:
        return Without(f"None is needed: without a damper zeta is {known}, {by}.", True)
    text = f"Without a damper zeta is {known}, {by}; {SURE:.1f} are needed to be sure."
    return Without(text, suffices=False)


def leave_out(name: str, flown: float) -> str:
    """Return what to do with the parameter of a damper that is not needed."""
    return f"Leave {name} at 0." if flown == 0.0 else f"{name} can be 0; it was {flown:g}."


def warnings(
    predicted: Predicted, name: str, flown: float, gains: Sequence[float | None]
) -> Iterable[Reason]:
    """Yield what speaks against the predictions; ``name`` is the parameter, ``flown`` its value.

    ``gains`` are the values that it had in each manoeuvre used, None where it changed in one.
    """
    known = [each for each in gains if each is not None]
    if len(set(known)) > 1 or len(known) < len(gains):
        values = ", ".join(f"{each:g}" for each in dict.fromkeys(known)) or "not constant"
        text = f"{name} was {values} in the manoeuvres used"
        if len(known) < len(gains):
            text += " and changed within one of them"
        yield Reason("gain_changed", f"{text}: {flown:g} is taken as flown", weight="warning")
    closed = predicted.closed
    G = predicted.aircraft.at(closed.airspeeds_m_s[0])  # noqa: N806
    s = np.array([1j * float(np.median(np.abs(G.dutch_roll)))])
    largest = max(flown, *known, 0.0)
    size = np.median(np.abs(predicted.laws[0].at(s, largest) * G.at(s)))
    if largest > 0.0 and size > MOSTLY_FEEDBACK:
        text = (
            f"with {name} {largest:g} the rudder moved mostly by feedback, and such answers were "
            "about 10 % off: fly once with half of it"
        )
        yield Reason("closed_loop", text, weight="warning")
    if takes_damping(closed):
        text = f"more {name} makes the Dutch roll less damped"
        yield Reason("lowers_damping", text, weight="warning")


def takes_damping(closed: Closed) -> bool:
    """Return whether a gain that is tried lowers zeta below that of no damper, at any airspeed."""
    return bool((closed.zeta < closed.zeta[:, :1]).any()) or not closed.damps[:, 1].all()


def sentences(
    predicted: Predicted, name: str, flown: float, found: Recommended | None, aim: float | None,
    without: Without,
) -> Iterable[str]:  # fmt: skip
    """Yield what the predictions mean: the band, the next step, and what to look for in flight."""
    closed = predicted.closed
    zeta, wn = closed.zeta, closed.wn_rad_s
    low_aim, _ = aimed(aim)
    at = int(np.argmin(np.abs(closed.gains - flown)))
    felt = f"wn {wn[0, at]:.3g} rad/s and zeta {zeta[0, at]:.2f}"
    if without.suffices:
        yield without.text
        yield leave_out(name, flown)
    yield f"The answer is {predicted.aircraft.words} without its damper" + (
        f"; {name} was {flown:g}, with which the pilot felt {felt}." if flown > 0.0 else "."
    )
    if takes_damping(closed):
        yield _with_more_gain(predicted, name)
    if found is None:
        if not without.suffices:
            yield _why_none(closed, name, without)
        return
    least = zeta[:, int(np.argmin(np.abs(closed.gains - found.high)))].min()
    if least < low_aim:
        yield (
            f"The margins allow {name} {found.high:g} at most, which gives zeta {least:.2f}: "
            f"{low_aim:g} is not reached."
        )
    first = ", a first step from no damper" if flown == 0.0 else ""
    yield f"Aim at {name} {found.low:g} to {found.high:g}. Fly {found.next:g} next{first}."
    row = int(np.argmin(np.abs(closed.gains - found.next)))
    for v, speed in enumerate(closed.airspeeds_m_s):
        yield (
            f"There the Dutch roll at {speed:.1f} m/s should have wn {wn[v, row]:.3g} rad/s and "
            f"zeta {zeta[v, row]:.2f} ± {closed.zeta_std[v, row]:.2f}."
        )
    yield (
        "A replay of that flight should find the same wn and zeta as now: those without damper. "
        "yawid diff of both runs compares the decay flown with the one predicted."
    )
    yield f"If the tail wags, or less damping is felt than before, set {name} {flown:g} again."
    yield PREDICTION


def _why_none(closed: Closed, name: str, without: Without) -> str:
    if without.text:
        return f"No gain is recommended. {without.text}"
    if not closed.damps[:, 1].all():
        return "No gain is recommended, as none surely adds damping."
    return (
        f"No gain is recommended: no {name} has a phase margin of 45 degrees and a gain margin of "
        "6 dB at every airspeed."
    )


def _with_more_gain(predicted: Predicted, name: str) -> str:
    """Return what more gain does where it makes the pair less damped."""
    closed = predicted.closed
    zeta, wn = closed.zeta, closed.wn_rad_s
    v, row = (int(i) for i in np.unravel_index(np.nanargmin(zeta - zeta[:, :1]), zeta.shape))
    G = predicted.aircraft.at(closed.airspeeds_m_s[v])  # noqa: N806
    lagging = predicted.aircraft.lag >= 0
    slow = G.poles[lagging, predicted.aircraft.lag[lagging]].real
    lag = f", behind a lag of {float(np.median(-1.0 / slow)):.2g} s" if len(slow) else ""
    return (
        f"At {closed.airspeeds_m_s[v]:.1f} m/s more {name} makes the Dutch roll less damped{lag} "
        f"(a slow servo or filter): {closed.gains[row]:g} would raise wn from {wn[v, 0]:.3g} to "
        f"{wn[v, row]:.3g} rad/s and lower zeta from {zeta[v, 0]:.2f} to {zeta[v, row]:.2f}."
    )
