"""The transfer function of a manoeuvre's answer, with the covariance of its numbers.

The numbers, x (p,), are those of :class:`Response`: wn and zeta of each pair, each real pole, then
for each input the residues: the real and the imaginary part of a pair's, and a real pole's.

From LOWEST to HIGHEST of wn the model holds. There G is linear in the residues R, G = X R, and a
record may know it well, though it does not know a real pole p: then p and R err together, far and
nearly without an effect. So p errs by at most a part of itself, and R takes over what the rest of
its error does to G there,

    R' = R + X^+ (dG/dp) (p' - p).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import HIGHEST, LOWEST, POINTS, Manoeuvre
from yawid.blocks import Floats
from yawid.errors import NotIdentifiable
from yawid.physics.continuous import Transfer, pole_of
from yawid.physics.modes import Complexes

MOST_OF_REAL: Final = 0.3
"""The largest sigma of a real pole that stays, as a part of it: what a larger one does is not
linear, and draws of a lag of 20 +- 10^5 1/s had no finite response. Chosen on 40 simulated
aircraft."""
STEP = 1e-3
"""Steps of the differences, in sigmas."""
LEAST_ZETA, MOST_ZETA = -0.9, 0.95
"""Where a draw's damping ratio ends: beyond them it is no pair."""


@dataclass(frozen=True, slots=True)
class Answered:
    """The model of a manoeuvre: x (p,) and their covariance (p, p), of so many pairs of poles.

    The first pair has at least the answer's total sigmas, whose floors its response does not show.
    """

    found: Manoeuvre
    inputs: tuple[str, ...]
    pairs: int
    x: Floats
    covariance: Floats

    @classmethod
    def of(cls, found: Manoeuvre) -> "Answered":
        """Return the model of a manoeuvre's answer.

        Raises:
            NotIdentifiable: it has none; the text says why.
        """
        answer = found.answer
        if answer is None or answer.response is None:
            raise NotIdentifiable(f"manoeuvre {found.n} has no model: {why_not(found.verdict)}")
        poles, by_input = np.array(answer.response.poles, float), answer.response.residues
        pairs = int(np.count_nonzero(poles[:, 1]))
        wn = np.hypot(*poles[:pairs].T)
        poles[:pairs] = np.stack([wn, -poles[:pairs, 0] / wn], axis=1)
        parts = [poles, *(np.array(each, float) for each in by_input.values())]
        x = np.concatenate([np.append(each[:pairs], each[pairs:, 0]) for each in parts])
        covariance, roll = np.array(answer.response.covariance, float), answer.dutch_roll
        for i, std in enumerate((roll.wn_std, roll.zeta_std) if roll else ()):
            covariance[i, i] = max(covariance[i, i], (std or 0.0) ** 2)
        return cls(found, tuple(by_input), pairs, x, covariance)._with_limited_reals()

    def _with_limited_reals(self) -> "Answered":
        reals, rest = slice(2 * self.pairs, self.order), slice(self.order, None)
        known = MOST_OF_REAL * np.abs(self.x[reals]) / np.maximum(self.std[reals], 1e-300)
        P, stays, s = np.eye(len(self.x)), np.minimum(1.0, known), band_of(float(self.x[0]))

        def responses(x: Floats) -> Complexes:
            return np.concatenate([G.at(s)[0] for G in self.transfers(x[None])])

        relative = changes_of(responses, self.x, P) / np.abs(responses(self.x))[:, None]
        slopes = np.concatenate([relative.real, relative.imag])
        taken = np.linalg.pinv(slopes[:, rest]) @ slopes[:, reals]
        P[reals, reals], P[rest, reals] = np.diag(stays), taken * (1.0 - stays)
        return replace(self, covariance=P @ self.covariance @ P.T)

    @property
    def std(self) -> Floats:
        """The sigmas (p,) of the numbers."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def order(self) -> int:
        """The number of poles, both of a pair counted."""
        return len(self.x) // (1 + len(self.inputs))

    def transfers(self, x: Floats | None = None) -> list[Transfer]:
        """Return the transfer functions from each input, for its own or other numbers (n, p)."""
        x = self.x[None] if x is None else x
        parts, n = np.split(x, 1 + len(self.inputs), axis=1), 2 * self.pairs
        (wn, zeta, real), *every = ((p[:, 0:n:2], p[:, 1:n:2], p[:, n:]) for p in parts)
        poles = _whole(pole_of(wn, zeta), real)
        return [Transfer(poles, _whole(re + 1j * im, rest)) for re, im, rest in every]

    @property
    def upper(self) -> Complexes:
        """One pole (m,) of each pair, then the real ones."""
        n = 2 * self.pairs
        return np.append(pole_of(self.x[0:n:2], self.x[1:n:2]), self.x[n : self.order])

    def drawn(self, count: int, rng: np.random.Generator) -> Floats:
        """Return draws (count, p) of the numbers.

        Frequencies and real poles are log-normal, so that none changes its sign.
        """
        x: Floats = rng.multivariate_normal(
            self.x, self.covariance, count, check_valid="ignore", method="eigh"
        )
        n = 2 * self.pairs
        signed = np.r_[0:n:2, n : self.order]
        x[:, signed] = self.x[signed] * np.exp(x[:, signed] / self.x[signed] - 1.0)
        x[:, 1:n:2] = np.clip(x[:, 1:n:2], LEAST_ZETA, MOST_ZETA)
        return x


def why_not(verdict: Verdict) -> str:
    """Return in words why there is no answer."""
    return "; ".join(str(each) for each in verdict.fatal or verdict.reasons)


def band_of(wn_rad_s: float) -> Complexes:
    """Return the points s (k,) on the imaginary axis between which a model holds."""
    return np.asarray(1j * wn_rad_s * np.linspace(LOWEST, HIGHEST, POINTS), complex)


def changes_of(
    of: Callable[[Floats], np.ndarray], values: Floats, covariance: Floats
) -> np.ndarray:
    """Return the changes (..., p) of a function, each by a sigma along an axis of the covariance.

    The squares of the changes add up to the variance; ``values`` (p,), ``covariance`` (p, p).
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size, axes = np.linalg.eigh(covariance / np.outer(*2 * [np.where(std > 0.0, std, 1.0)]))
    steps = STEP * (std[:, None] * axes * np.sqrt(np.maximum(size, 0.0))).T
    return np.stack([of(values + d) - of(values - d) for d in steps], axis=-1) / (2.0 * STEP)


def _whole(pairs: Complexes, reals: Floats) -> Complexes:
    """Return pairs (n, m) with their conjugates next to them, then the real ones."""
    both = np.stack([pairs, np.conj(pairs)], axis=2).reshape(len(pairs), -1)
    return np.concatenate([both, reals.astype(complex)], axis=1)
