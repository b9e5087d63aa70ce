"""Thirty small defects, as a hurried change might bring them in: where, what for what, and why."""

from __future__ import annotations

from dataclasses import dataclass

ESTIMATION = ("tests/estimation",)
CHANNELS = ("tests/channels", "tests/test_truth.py", "tests/test_regress_truth.py")
PHYSICS = ("tests/physics",)
VERDICT = ("tests/test_verdict.py",)
SOURCES = ("tests/sources",)
GOLDEN = ("tests/test_regress_command.py",)


@dataclass(frozen=True, slots=True)
class Defect:
    """``old``, once in ``file`` (below src/yawid), becomes ``new``; ``tests`` should then fail."""

    what: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]


DEFECTS = (
    Defect(
        "y enters phi with the wrong sign",
        "estimation/recursion.py",
        "fresh[0] = -y\n",
        "fresh[0] = y\n",
        ESTIMATION,
    ),
    Defect(
        "a priori innovation for a posteriori residual in phi",
        "estimation/recursion.py",
        "fresh[len(fresh) - 2] = eps if",
        "fresh[len(fresh) - 2] = e if",
        ESTIMATION,
    ),
    Defect(
        "input one sample too new (nk - 1)",
        "estimation/layout.py",
        "rows += [(nk, nb) for",
        "rows += [(nk - 1, nb) for",
        ESTIMATION,
    ),
    Defect(
        "lambda left out of the gain",
        "estimation/kernel.py",
        "alpha, inverse, column = lam, 1.0 / lam, 0",
        "alpha, inverse, column = 1.0, 1.0, 0",
        ESTIMATION,
    ),
    Defect(
        "lambda left out of the growth of P",
        "estimation/upkeep.py",
        "n, over = len(d), 1.0 / lam",
        "n, over = len(d), 1.0",
        ESTIMATION,
    ),
    Defect(
        "forgetting that stays at its start",
        "estimation/upkeep.py",
        "(1.0 - s[LAMBDA_RATE]) * s[LAMBDA_END]",
        "(1.0 - s[LAMBDA_RATE]) * lam",
        ESTIMATION,
    ),
    Defect(
        "RML filters by C(q) with the sign of 1/C(q) turned",
        "estimation/recursion.py",
        "x -= power * theta[first + i]",
        "x += power * theta[first + i]",
        ESTIMATION,
    ),
    Defect(
        "half of Jury's test left out",
        "estimation/kernel.py",
        "return abs(a[1]) < 1.0 and abs(a[0]) < 1.0 + a[1]",
        "return abs(a[1]) < 1.0",
        ESTIMATION,
    ),
    Defect(
        "updates before the lags are full",
        "estimation/recursion.py",
        "learning = s[FILL] > s[DEPTH] + s[NC]",
        "learning = s[FILL] > s[DEPTH]",
        ESTIMATION,
    ),
    Defect(
        "lags kept across a gap",
        "estimation/recursion.py",
        "if s[BROKEN] > 0.0:\n        _open(s, at)",
        "if s[BROKEN] > 1.0:\n        _open(s, at)",
        ESTIMATION,
    ),
    Defect(
        "no floor under the information",
        "estimation/upkeep.py",
        "if p > limit:",
        "if p > 1e300 * limit:",
        ESTIMATION,
    ),
    Defect(
        "weights' squares summed without the square",
        "estimation/upkeep.py",
        "s[S2] = lam * lam * s[S2] + 1.0",
        "s[S2] = lam * s[S2] + 1.0",
        ESTIMATION,
    ),
    Defect(
        "units of b turned upside down",
        "estimation/entry.py",
        "units[i] = factors[j] / factors[0]",
        "units[i] = factors[0] / factors[j]",
        ESTIMATION,
    ),
    Defect(
        "parameters not taken off in the noise variance",
        "estimation/upkeep.py",
        "s[LOSS] / max(s[S1] - s[N] * s[S2] / s[S1], 1.0)",
        "s[LOSS] / s[S1]",
        ESTIMATION,
    ),
    Defect(
        "yaw not unwrapped",
        "channels/yaw.py",
        "unwrapped[rows] = known + 2.0 * np.pi * turns",
        "unwrapped[rows] = known + 0.0 * turns",
        CHANNELS,
    ),
    Defect(
        "32-bit servo time not unwrapped",
        "channels/clock.py",
        "unwrapped: Ints = raw + turns * 2**32",
        "unwrapped: Ints = raw + 0 * turns",
        CHANNELS,
    ),
    Defect(
        "trim ignored: the middle of the travel for it",
        "channels/surface.py",
        "value = (pwm - trim) /",
        "value = (pwm - 0.5 * (low + high)) /",
        CHANNELS,
    ),
    Defect(
        "reversed servo not turned",
        "channels/surface.py",
        "return -value if self.reversed else value",
        "return value",
        CHANNELS,
    ),
    Defect(
        "V-tail's elevator taken for its rudder",
        "channels/mapping.py",
        "return _servo(left, table, weight), _servo(right, table, -weight)",
        "return _servo(left, table, weight), _servo(right, table, weight)",
        CHANNELS,
    ),
    Defect(
        "rudder at the instant for its mean over the interval",
        "channels/align.py",
        "mean = np.add.reduceat(area, starts, axis=0) / self._ts_us",
        "mean = self._surface.values[holds[starts]]",
        CHANNELS,
    ),
    Defect(
        "yaw rate of the message before for the interpolated",
        "channels/align.py",
        "between = low + weight[:, None] * (high - low)",
        "between = low + 0.0 * weight[:, None] * (high - low)",
        CHANNELS,
    ),
    Defect(
        "gaps bridged a hundred times longer",
        "channels/startup.py",
        "BRIDGED = 3.0",
        "BRIDGED = 300.0",
        (*CHANNELS, "tests/test_faults.py"),
    ),
    Defect(
        "turn rate added for subtracted",
        "channels/conditioning.py",
        "y=block.y - turn",
        "y=block.y + turn",
        CHANNELS,
    ),
    Defect(
        "heading rate by Euler with a wrong sign",
        "channels/yaw.py",
        "(q * np.sin(roll) + r * np.cos(roll))",
        "(r * np.cos(roll) - q * np.sin(roll))",
        CHANNELS,
    ),
    Defect(
        "zero-order hold not undone in the residues",
        "physics/modes.py",
        "residues = discrete * s / (z - 1.0)",
        "residues = discrete / sample_time_s",
        PHYSICS,
    ),
    Defect(
        "sigma of zeta by the wrong slope",
        "physics/modes.py",
        "dzeta = -ds.real / wn + s.real",
        "dzeta = -ds.real / wn - s.real",
        PHYSICS,
    ),
    Defect(
        "eq. 22: yaw damping with the side force added",
        "physics/derivatives.py",
        "a_omega = 2.0 * xi * omega - a_z",
        "a_omega = 2.0 * xi * omega + a_z",
        PHYSICS,
    ),
    Defect(
        "inputs that move together are let through",
        "verdict.py",
        "if close > COLLINEAR:",
        "if close > 1.0 + COLLINEAR:",
        VERDICT,
    ),
    Defect(
        "a replayed signature accepted once more",
        "sources/signing.py",
        "if stamp <= self._streams.get(",
        "if stamp < self._streams.get(",
        SOURCES,
    ),
    Defect(
        "a golden comparison that lets a million tolerances pass",
        "golden.py",
        "(np.abs(actual - expected) <= allowed)",
        "(np.abs(actual - expected) <= 1e6 * allowed)",
        GOLDEN,
    ),
)
