"""Whether a free run may answer a manoeuvre: calm air, and a rudder that moved by itself.

Output error takes all that the rudder does not explain for noise of the measurement. A gust is not:
the aircraft responds to it at its own mode, as it does to the rudder, and a rudder that feeds back
what the gust did hides that. Three figures show it; the thresholds are from flights of JSBSim.
"""

from collections.abc import Iterator

import numpy as np

from yawid.blocks import Floats, shifted
from yawid.manoeuvres.feedback import near_mode
from yawid.results.judge_samples import explained
from yawid.results.reasons import Reason

MOST_POWER = 0.015
"""Power of the free run's residual near the mode, over that of the yaw rate there: gusts excite the
mode, noise of a gyro hardly. It was below 0.015 in 71 of 71 calm answers."""
NEGLIGIBLE = 0.0005
"""That power below which it is not asked whether the rudder feeds the residual back: it is 2 % of
the yaw rate. A rudder of few pulses resembles so small a residual by chance."""
MOST_RATIO = 12.0
"""Variance of the free run's residual over that of the innovations: one step ahead a gust is
predicted by what it has done already, a free run never sees it."""
MOST_FED_BACK = 0.2
"""Part of the rudder that earlier residuals of the free run explain: it is fed back, by a damper or
by a mix, and does not move by itself."""
FED_BACK_LAGS, FED_BACK_S = 10, 0.15
"""How many earlier residuals are looked at, and how far apart they are in s."""
MOST_APART = 0.12
"""Part of wn by which output error and maximum likelihood may differ: structure errors of ARMAX
were 8 % at most."""


def is_calm(
    left: Floats, innovations: Floats, rudder: Floats, y: Floats, wn_rad_s: float, ts_s: float
) -> bool:
    """Return whether output error may answer for samples of ``rudder`` and ``y`` (n,).

    ``left`` (n,) is what its free run leaves of y, ``innovations`` (n,) what ARMAX leaves one step
    ahead; rows with NaN are left out.
    """
    known = np.isfinite(left) & np.isfinite(innovations) & np.isfinite(y)
    if not known.any():
        return False
    power, ratio = (np.mean(x[known] ** 2) for x in (left, innovations))
    spacing = max(1, round(FED_BACK_S / ts_s))
    lags = [shifted(left, 1 + spacing * i) for i in range(FED_BACK_LAGS)]
    near, whole = (near_mode(x[known], wn_rad_s, ts_s) for x in (left, y))
    return bool(
        power < MOST_RATIO * ratio
        and near < MOST_POWER * whole
        and (near < NEGLIGIBLE * whole or explained(rudder, np.column_stack(lags)) < MOST_FED_BACK)
    )


def apart_reasons(wn_rad_s: float, other_rad_s: float) -> Iterator[Reason]:
    """Judge how far wn by output error is from that by maximum likelihood, if there is one."""
    if abs(other_rad_s - wn_rad_s) > MOST_APART * wn_rad_s:
        yield Reason(
            "not_converged",
            f"wn is {wn_rad_s:.3g} rad/s by OE and {other_rad_s:.3g} by RML: they may differ by "
            f"{100 * MOST_APART:g} % at most",
        )
