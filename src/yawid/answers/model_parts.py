"""Parts of a model in an answer: its modes, its numbers, and how well it fits."""

import math
from collections.abc import Sequence

from yawid.answers.part import Count, Number, Part, Positive
from yawid.quantities.flying_qualities import dutch_roll_level


class Mode(Part, frozen=True, kw_only=True):
    """One mode, a real pole or a pair: frequency in rad/s, times in s, sigmas of noise alone."""

    kind: str
    wn_rad_s: Number | None = None
    wn_std: Number | None = None
    zeta: Number | None = None
    zeta_std: Number | None = None
    period_s: Number | None = None
    time_constant_s: Number | None = None


class Fit(Part, frozen=True):
    """How much of the measurements the model explains, in percent, and its residuals."""

    one_step_pct: Number | None = None
    simulation_pct: Number | None = None
    innovation_std: Number | None = None
    residual_std: Number | None = None
    whiteness_p: Number | None = None
    spr_margin: Number | None = None


class DutchRoll(Part, frozen=True, kw_only=True):
    """The answer: natural frequency in rad/s, damping ratio, their sigmas, MIL-F-8785C's level.

    Of a flight ``*_std`` is the sigma of the next manoeuvre, ``*_std_mean`` that of the mean.
    ``*_std`` is the total sigma; ``*_std_noise`` is the part that noise alone explains. Where that
    is None, as of the running estimates, ``*_std`` is the sigma of noise.
    """

    wn_rad_s: Positive
    wn_std: Number | None = None
    wn_std_noise: Number | None = None
    wn_std_mean: Number | None = None
    zeta: Number
    zeta_std: Number | None = None
    zeta_std_noise: Number | None = None
    zeta_std_mean: Number | None = None
    level: Count | None = None

    @staticmethod
    def of(
        row: Sequence[float],
        noise: Sequence[float] = (math.nan,) * 2,
        of_mean: Sequence[float] = (math.nan,) * 2,
        *,
        has_level: bool = False,
    ) -> "DutchRoll | None":
        """Return it from a row of wn, its sigma, zeta and its sigma, None if wn or zeta is NaN.

        ``noise`` has the two sigmas that noise explains, ``of_mean`` those of a flight's mean.
        """
        numbers = (float(x) if math.isfinite(x) else None for x in (*row, *noise, *of_mean))
        wn, wn_std, zeta, zeta_std, wn_noise, zeta_noise, wn_mean, zeta_mean = numbers
        if wn is None or zeta is None or not wn > 0.0:
            return None
        return DutchRoll(
            wn_rad_s=wn, wn_std=wn_std, wn_std_noise=wn_noise, wn_std_mean=wn_mean,
            zeta=zeta, zeta_std=zeta_std, zeta_std_noise=zeta_noise, zeta_std_mean=zeta_mean,
            level=dutch_roll_level(wn, zeta) if has_level else None,
        )  # fmt: skip


class Value(Part, frozen=True):
    """A coefficient of eq. 22-23, its total sigma, and the part of it that noise explains.

    Without that part ``std`` is of noise alone.
    """

    value: Number | None = None
    std: Number | None = None
    std_noise: Number | None = None


class TimeConstant(Part, frozen=True):
    """The time constant of a real mode in s, negative where it diverges, and its sigma."""

    time_constant_s: Number
    std: Number | None = None
