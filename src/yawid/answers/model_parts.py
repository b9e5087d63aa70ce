"""Parts of a model in an answer: its modes, and how well it fits."""

from yawid.answers.part import Number, Part


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
