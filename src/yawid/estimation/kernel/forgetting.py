"""What surrounds each update: forgetting, the information floor, the running sums."""

# numba infers the types: float64 arrays and floats.
# mypy: disable-error-code="no-untyped-def, no-untyped-call"
import math

from yawid.estimation.kernel.linear_algebra import correlate, entry_of_p, floor
from yawid.estimation.kernel.marks import hot
from yawid.estimation.kernel.state import FAST, FAST_FALL, MOST_RISE, SETTLING, SLACK, SLOW_RISE


@hot
def _keep_information(s, at):
    """Keep the floor under what is known of one parameter, the next at each update.

    P[k, k] may exceed its usual least by the share SLACK / FLOOR; beyond, a row "theta[k] is what
    it is", just heavy enough, brings it back. The usual least falls fast and rises over many
    memories, no further than to MOST_RISE times the best there was, so that neither poverty, be it
    days of it, nor one wild sample sets it. While the signals excite, no row
    is added: rows of a fixed weight outweigh the little that quiet noise says of C.
    """
    k, n = int(s.next), len(at.d)
    s.next = 0.0 if k + 1 == n else k + 1.0
    p = entry_of_p(at.d, at.upper, k, k)
    if p >= at.least[k]:
        rise = 1.0 + SLOW_RISE * n * (1.0 - s.lam_end)
        at.least[k] = min(at.least[k] * rise, MOST_RISE * at.best[k])
    else:
        at.least[k] = p if s.since < SETTLING else max(p, FAST_FALL * at.least[k])
        at.best[k] = min(at.best[k], at.least[k])
    limit = at.least[k] * (1.0 + SLACK / s.floor)
    if p > limit:
        floor(at.d, at.upper, k, 1.0 / limit - 1.0 / p, at.gain)


@hot
def noise_variance(s):
    """Return the variance of the innovation on scaled signals; NaN before the first update."""
    if s.s1 == 0.0:
        return math.nan
    return s.loss / max(s.s1 - s.n * s.s2 / s.s1, 1.0)


@hot
def adapt(s, at, lam):
    """Keep information in P, and let the forgetting factor approach its end."""
    if s.floor > 0.0:
        _keep_information(s, at)
    s.lam = s.lam_rate * lam + (1.0 - s.lam_rate) * s.lam_end


@hot
def account(s, at, y, e, eps, lam, share):
    """Keep the running sums, and test for divergence: y_hat much worse than none at all."""
    s.s1 = lam * s.s1 + 1.0
    s.s2 = lam * lam * s.s2 + 1.0
    s.loss = lam * s.loss + e * e * share
    s.e2 = lam * s.e2 + e * e
    s.eps2 = lam * s.eps2 + eps * eps
    s.y2 = lam * s.y2 + y * y
    s.fast_e2 = FAST * s.fast_e2 + (1.0 - FAST) * e * e
    s.fast_y2 = FAST * s.fast_y2 + (1.0 - FAST) * y * y
    if s.lags > 0.0:
        correlate(at.residuals, at.products, eps, lam)
    s.updates += 1.0
    s.since += 1.0
    now, usual = s.fast_e2 * s.s1, max(s.fast_y2 * s.s1, s.y2) + 1e-4 * s.s1
    if s.diverged == 0.0:
        if s.since > s.warm and now > 4.0 * usual:
            s.diverged = 1.0
    elif s.since > 2.0 * s.warm and now < 2.0 * usual:
        s.diverged = 0.0
