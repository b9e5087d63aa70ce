"""One manoeuvre from its samples to its answer: inputs and outputs, the fit, the verdict.

The inputs are the rudder and, where it moves by itself and explains more of the yaw rate, the
aileron; the outputs are the yaw rate, less the turn rate where eq. 23 fits it better so, and
roll. What the user gives (``--inputs``, ``--turn``) binds.
"""

import math
from collections.abc import Mapping
from typing import Final

import msgspec
import numpy as np

from yawid.answers.model_parts import Fit as HowWell
from yawid.answers.model_parts import Mode
from yawid.answers.reasons import Verdict
from yawid.answers.run_summary import (
    CT,
    Conditions,
    DutchRoll,
    Manoeuvre,
    MethodSummary,
    OneStructure,
    Orders,
    Response,
    Value,
)
from yawid.blocks import EstimateBlock, SampleBlock, finite
from yawid.config.run import BOTH
from yawid.estimation.polynomials import parameter_names
from yawid.manoeuvre.answer import Answer, Known, answer_of
from yawid.manoeuvre.conditions import conditions
from yawid.manoeuvre.fit import Fit
from yawid.manoeuvre.judge import Evidence, ManoeuvreSetting, reasons
from yawid.manoeuvre.responses import averaged
from yawid.manoeuvre.signals import fitted, is_turning
from yawid.physics.continuous import overshoot_of, pole_of, settling_of
from yawid.physics.modes import modes
from yawid.quantities.vehicles import AIRFRAME, WITH_ROLL_LOOP

DRAWS: Final = 200
MOST_ZETA: Final = 0.995
"""Where a draw's damping ratio ends: beyond it there is no pair."""


def answer(
    samples: SampleBlock,
    n: int,
    setting: ManoeuvreSetting,
    running: Mapping[str, EstimateBlock] | None = None,
) -> Manoeuvre:
    """Return the answer of the ``n``-th manoeuvre from its samples.

    ``running`` holds the recursive estimates of its last sample, which are shown with it.
    """
    config, (found, untrue) = setting.config, conditions(samples, n, setting.modes_of)
    measured = config.rudder_is == "measured"
    turn = config.turn == "keep" and not config.binds("turn")
    turn = turn and is_turning(samples, measured=measured)
    if config.output == "yaw":
        samples = averaged(samples, measured=measured)
    leaves = found.loop != WITH_ROLL_LOOP and not config.binds("inputs")
    seen = fitted(
        samples,
        None if leaves else config.inputs,
        measured=measured,
        turn_removed=turn,
    )
    has_loop = found.loop != AIRFRAME and seen.inputs != BOTH
    by_fit = answer_of(seen.fits, has_roll_loop=has_loop)
    evidence = Evidence(samples, setting, turn, seen, by_fit)
    verdict = Verdict.of([*reasons(evidence), *([] if untrue is None else [untrue])], CT)
    estimates = {name: _of_stream(name, each, setting) for name, each in (running or {}).items()}
    if seen.fits:
        estimates = {CT: _summary(evidence, found, usable=verdict.usable)} | estimates
    return Manoeuvre(
        **msgspec.structs.asdict(found),
        inputs=list(seen.inputs),
        turn_removed=turn or config.turn == "remove",
        estimates=estimates,
        verdict=verdict,
    )


def _of_stream(method: str, last: EstimateBlock, setting: ManoeuvreSetting) -> MethodSummary:
    """Return what a recursive method had at the end of a manoeuvre, with P's sigmas."""
    config, orders = setting.config, setting.config.armax_orders()
    names = parameter_names(orders, config.inputs, bias=True)
    found = modes(last, orders, setting.sample_time_s, mean_output=config.output == "yaw")
    return MethodSummary(
        method=method,
        orders=Orders(*config.orders),
        sample_time_s=setting.sample_time_s,
        theta=finite(dict(zip(names, last.theta[0], strict=True))),
        theta_std=finite(dict(zip(names, last.theta_std[0], strict=True))),
        dutch_roll=DutchRoll.of(found.dutch_roll[0]),
        fit=HowWell(**finite({"innovation_std": last.noise_std[0]})),
    )


def _summary(of: Evidence, found: Conditions, *, usable: bool) -> MethodSummary:
    """Return the answer as ``--json`` prints it, of the evidence of a manoeuvre that has a fit.

    How the yaw rate swings after a step stands only in one that is usable.
    """
    fit, answer, seen = of.fit, of.answer, of.seen
    assert fit is not None
    samples = int(np.diff(fit.blocks.record.runs).sum())
    bare = MethodSummary(
        method=CT,
        sample_time_s=of.setting.sample_time_s,
        updates=samples,
        held=len(fit.blocks.record.u) - samples,
        structure=fit.structure.name,
        roll_left_out=seen.roll_left_out or None,
        fit=HowWell(simulation_pct=of.explained_pct),
    )
    if answer is None:
        return bare
    wn, zeta, rudder = answer.wn_rad_s, answer.zeta, answer.eq_23
    noise = _noise(seen.fits, answer)
    response = response_of(answer, seen.inputs)
    numbers = _eq_22(wn, zeta, rudder.K, rudder.T_s, rudder.yaw_acceleration)
    return msgspec.structs.replace(
        bare,
        modes=_modes(answer.model),
        dutch_roll=DutchRoll.of((*wn, *zeta), noise, has_level=found.loop == AIRFRAME),
        physics={name: Value(each.value, each.std) for name, each in numbers.items()},
        yaw_acceleration=Value(*rudder.yaw_acceleration),
        response=response,
        structures=_structures(seen.fits, answer),
        **(step_of(response) if usable else {}),
    )


def _noise(fits: list[Fit], answer: Answer) -> tuple[float, float]:
    """Return the sigmas of wn and zeta that noise alone explains, the mean over the structures."""
    weights = answer.weights
    some = [(weights[each.name], each) for each in fits if each.name in weights]
    log_wn, zeta = (math.sqrt(sum(w * each.pair_std[i] ** 2 for w, each in some)) for i in range(2))
    return answer.wn_rad_s.value * log_wn, zeta


def _structures(fits: list[Fit], answer: Answer) -> dict[str, OneStructure]:
    """Return what each structure found."""
    found = {}
    for fit in fits:
        (log_wn, log_zeta), (wn_std, zeta_std) = fit.log_pair.tolist(), fit.pair_std
        wn = math.exp(log_wn)
        weight = answer.weights.get(fit.name, 0.0)
        found[fit.name] = OneStructure(
            wn_rad_s=wn, wn_std=wn * wn_std, zeta=math.exp(log_zeta), zeta_std=zeta_std,
            weight=weight,
        )  # fmt: skip
    return found


def _eq_22(wn: Known, zeta: Known, K: Known, T: Known, rate: Known) -> dict[str, Known]:
    """Return the numbers of eq. 22-23 of eq. 23's.

    T = 1/a_z, 2 xi omega = a_omega + a_z, omega^2 = a_omega a_z + a_beta, K omega^2 = a_delta a_z:
    see :mod:`yawid.physics.derivatives`. T and the pair count as independent.
    """
    a_z = 1.0 / T.value
    a_omega = 2.0 * zeta.value * wn.value - a_z
    a_z_std = T.std * a_z**2
    a_omega_std = math.hypot(2.0 * wn.value * zeta.std, 2.0 * zeta.value * wn.std, a_z_std)
    a_beta_std = math.hypot(
        2.0 * (wn.value - zeta.value * a_z) * wn.std,
        2.0 * wn.value * a_z * zeta.std,
        (2.0 * zeta.value * wn.value - 2.0 * a_z) * a_z_std,
    )
    return {
        "K": K, "T_theta_s": T, "omega_beta": wn, "xi_beta": zeta, "a_z_beta": Known(a_z, a_z_std),
        "a_my_omega_y": Known(a_omega, a_omega_std),
        "a_my_beta": Known(wn.value**2 - a_omega * a_z, a_beta_std), "a_my_delta_h": rate,
    }  # fmt: skip


def _modes(model: Fit) -> list[Mode]:
    """Return the modes of the answer's model: the pair, then the real poles."""
    found = []
    for pole in model.structure.poles(model.theta).tolist():
        if pole.imag:
            wn = abs(pole)
            found.append(Mode(kind="oscillatory", wn_rad_s=wn, zeta=-pole.real / wn,
                              period_s=2.0 * math.pi / pole.imag))  # fmt: skip
        else:
            found.append(Mode(kind="real", time_constant_s=-1.0 / pole.real))
    return found


def response_of(answer: Answer, inputs: tuple[str, ...]) -> Response:
    """Return the transfer function of an answer's model, with the covariance of its numbers.

    Fit and answer have them as log w, log zeta, log a and elements of beta: 1/2 (c - i d) are a
    pair's residues, and those of a lag are minus their sum.
    """
    model, structure = answer.model, answer.model.structure
    poles = structure.poles(model.theta)
    residues = structure.residues(model.elements, len(inputs))
    residues[: structure.pairs] *= 0.5
    by_theta = np.exp(model.theta)
    by_theta[2 * structure.pairs :] *= -1.0
    width = structure.mixing
    half = np.ones(len(width))
    half[: 2 * structure.pairs] = 0.5
    half[1 : 2 * structure.pairs : 2] = -0.5
    each = half[:, None] * width
    slopes = np.zeros((len(by_theta) + len(inputs) * len(width), len(model.covariance)))
    slopes[: len(by_theta), : len(by_theta)] = np.diag(by_theta)
    slopes[len(by_theta) :, len(by_theta) :] = np.kron(np.eye(len(inputs)), each)
    return Response(
        poles=[[p.real, p.imag] for p in poles.tolist()],
        residues={
            name: [[r.real, r.imag] for r in residues[:, i].tolist()]
            for i, name in enumerate(inputs)
        },
        covariance=(slopes @ model.covariance @ slopes.T).tolist(),
    )


def step_of(response: Response) -> dict[str, Value]:
    """Return how the yaw rate swings after a step of the rudder, by the names of the summary.

    Sigma is the spread of draws of the pair and its residue: the time jumps by half a swing where
    one more of them exceeds 5 %. Frequency and damping are log-normal: none changes its sign.
    """
    pole, residue = (complex(*each[0]) for each in (response.poles, response.residues["rudder"]))
    first = sum(2 if imag else 1 for _, imag in response.poles)
    C = np.array(response.covariance)[np.ix_(*2 * [[0, 1, first, first + 1]])]
    normal = np.random.default_rng(0).normal(size=(1 + DRAWS, 4))
    normal[0] = 0.0
    moved = normal @ np.linalg.cholesky(C + 1e-9 * np.diag(np.diag(C))).T
    pair = np.array([abs(pole), -pole.real / abs(pole)])
    wn, zeta = (pair * np.exp(moved[:, :2] / pair)).T
    zeta = np.minimum(zeta, MOST_ZETA)
    found = {
        "overshoot_pct": 100.0 * overshoot_of(zeta),
        "settling_s": settling_of(pole_of(wn, zeta), residue + moved[:, 2] + 1j * moved[:, 3]),
    }
    return {
        name: Value(float(x[0]), float(np.sqrt(np.mean((x[1:] - x[0]) ** 2))))
        for name, x in found.items()
    }
