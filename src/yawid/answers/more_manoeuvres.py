"""How well a flight's answer will be known after more manoeuvres like those it rests on.

Sigma of a next manoeuvre is sqrt(common² + noise² + tau²): noise falls with 1/sqrt(n), tau is the
scatter between manoeuvres, and the common part, which the model's structure leaves out, stays.
Sigma of the mean, on which a controller rests, has tau²/n in place of tau².
"""

import math
from collections.abc import Iterator
from typing import Final

from msgspec.structs import replace

from yawid.answers.flight_test_card import Expected
from yawid.answers.run_summary import TAU_WN_SHARE, TAU_ZETA, Flight

MANOEUVRES: Final = 4
"""Manoeuvres at each airspeed. Up to four, at least 1.5 % of wn is taken as their scatter."""
MORE: Final = (MANOEUVRES, 2 * MANOEUVRES)
"""After how many more manoeuvres sigma is predicted."""


def expected(flight: Flight | None) -> Iterator[Expected]:
    """Yield the sigmas of a next manoeuvre after more of them; nothing where they are unknown."""
    roll = None if flight is None else flight.dutch_roll
    if flight is None or roll is None or roll.wn_std is None or flight.between_std is None:
        return
    n = len(flight.used)
    floors = (
        (roll.wn_std, roll.wn_std_noise, flight.between_std.wn_rad_s, TAU_WN_SHARE * roll.wn_rad_s),
        (roll.zeta_std, roll.zeta_std_noise, flight.between_std.zeta, TAU_ZETA),
    )
    for more in MORE:
        wn, zeta = (sigma_after(n, more, *each) for each in floors)
        if wn is not None:
            yield Expected(more=more, wn_std=wn, zeta_std=zeta)


def sigma_after(
    n: int, more: int, std: float | None, noise: float | None, tau: float | None, floor: float
) -> float | None:
    """Return the sigma after ``more`` manoeuvres in addition to the n that gave ``std``."""
    if std is None or noise is None or tau is None:
        return None
    common = max(std**2 - noise**2 - tau**2, 0.0)
    # A scatter at its floor was not measured: the floor sinks as more manoeuvres measure it.
    now, later = (floor * min(1.0, (3.0 / max(count - 1, 1)) ** 0.5) for count in (n, n + more))
    tau = later if tau <= 1.001 * now else tau
    return math.sqrt(common + noise**2 * n / (n + more) + tau**2)


def of_mean(flight: Flight, more: int = 0) -> Flight:
    """Return the flight with the sigmas of the mean over its manoeuvres, also after ``more``.

    A sigma without its parts stays as it is.
    """
    roll, between, n = flight.dutch_roll, flight.between_std, len(flight.used)
    if roll is None or between is None:
        return flight

    def mean(std: float | None, noise: float | None, tau: float | None) -> float | None:
        if std is None or noise is None or tau is None:
            return std
        whole = math.sqrt(max(std**2 - tau**2, 0.0))
        # The scatter is a part of the mean's noise: no tau is left, and no floor.
        return sigma_after(n, more, whole, math.hypot(noise, tau / math.sqrt(n)), 0.0, 0.0)

    wn_std = mean(roll.wn_std, roll.wn_std_noise, between.wn_rad_s)
    zeta_std = mean(roll.zeta_std, roll.zeta_std_noise, between.zeta)
    return replace(flight, dutch_roll=replace(roll, wn_std=wn_std, zeta_std=zeta_std))
