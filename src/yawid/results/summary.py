"""The summary of a run: all that ``--json`` prints, the verdict, and the part of each method."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from msgspec.structs import replace

from yawid.answers.channel_report import ChannelReport
from yawid.answers.heard import LinkCounts
from yawid.answers.model_parts import Fit, Mode
from yawid.answers.run_summary import (
    Bare,
    DutchRoll,
    Flight,
    Manoeuvre,
    MethodSummary,
    Orders,
    ReasonSummary,
    RunSummary,
    Value,
    VerdictSummary,
)
from yawid.blocks import WINDOW_S, Floats, Held, ModesBlock, finite, strokes, window_of, words
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank, PastModels, SampleHistory
from yawid.estimation.fit import LEAST_SAMPLES, TRAINING, fit_percent, simulate
from yawid.estimation.methods import METHODS
from yawid.estimation.polynomials import c_of, parameter_names, spr_margin
from yawid.estimation.whiteness import largest_autocorrelation
from yawid.physics.derivatives import summary_of
from yawid.physics.model_response import early_response
from yawid.physics.modes import dutch_roll_of, mode_list, modes
from yawid.quantities.link import LinkStats
from yawid.quantities.table import REDUCTION_ERROR
from yawid.results.advice import advised
from yawid.results.excitation import LEAST_STROKE
from yawid.results.judge_estimate import Estimates, Evidence, bank_verdict
from yawid.results.judge_samples import IF_IT_FLEW, NO_VALUE, changed_rates, why_believed
from yawid.results.reasons import Reason, Verdict
from yawid.results.structures import NEWEST, NOTHING_KNOWN, SPREAD_MEMORIES, Spread, spread_of
from yawid.results.yaw_loop import with_yaw_loop


class Finished(Protocol):
    """A finished run: its estimators, None where there was no sample, and its configuration."""

    bank: Bank | None
    config: RunConfig

    def report(self) -> ChannelReport:
        """Return the report of its channels."""

    @property
    def manoeuvres(self) -> list[Manoeuvre] | None:
        """The manoeuvres found, None where none were searched for."""

    def flights(self, of_the_log: list[Reason]) -> list[tuple[Flight, Verdict]]:
        """Return the flight's answers, the headline first; none where there is no manoeuvre."""

    def bare(self) -> Bare | None:
        """Return the bare airframe of all its manoeuvres, None where none was looked for."""


def summarise(
    pipeline: Finished, link: LinkStats, log: str, sha256: str
) -> tuple[RunSummary, Verdict]:
    """Return the summary of a finished pipeline, and the verdict that decides: see ``deciding``.

    ``link`` holds the counts of what was read; ``log`` and ``sha256`` identify the file.
    """
    bank, report = pipeline.bank, pipeline.report()
    estimates: dict[str, MethodSummary] | None = None
    evidence: dict[str, Evidence] = {}
    if bank is not None and report.rudder_message is not None:
        estimates, evidence = bank_summaries(bank)
    basis = _basis(pipeline, report, link)
    verdict = Verdict.of(basis.reasons) if bank is None else basis.verdict(bank, evidence)
    flights = pipeline.flights(of_the_log(verdict.reasons))
    summary = RunSummary(
        log=log,
        sha256=sha256,
        duration_s=max((link.last_us or 0) - (link.first_us or 0), 0) / 1e6,
        vehicle=report.vehicle,
        vehicles=report.vehicles if len(report.vehicles) > 1 else None,
        boots=report.boots if len(report.boots) > 1 else None,
        link=_link(link, report),
        channels=dict(report.channels),
        estimates=estimates,
        verdict=as_summary(verdict),
        manoeuvres=pipeline.manoeuvres,
        bare=pipeline.bare(),
    )
    return concluded(summary, verdict, flights)


def concluded(
    summary: RunSummary, verdict: Verdict, flights: Sequence[tuple[Flight, Verdict]]
) -> tuple[RunSummary, Verdict]:
    """Return the summary with its flight's answers and with advice, and the verdict that decides.

    ``verdict`` is the stream's; ``flights`` are the flight's answers, the headline first.
    """
    if not flights:
        return advised(with_yaw_loop(summary)), verdict
    usable = [flight for flight, _ in flights if flight.used]
    summary = replace(summary, flight=flights[0][0], flights=usable or None)
    return advised(with_yaw_loop(summary)), flights[0][1]


def of_the_log(reasons: Iterable[Reason]) -> list[Reason]:
    """Return the reasons that also hold for a flight's manoeuvres: those of the run and the log."""
    return [reason for reason in reasons if reason.kind.origin in ("run", "log")]


def as_summary(verdict: Verdict) -> VerdictSummary:
    """Return the verdict as ``--json`` prints it."""
    reasons = [ReasonSummary(r.id, r.weight, r.text) for r in verdict.reasons]
    return VerdictSummary(method=verdict.method, usable=verdict.usable, reasons=reasons)


def _link(link: LinkStats, report: ChannelReport) -> LinkCounts:
    if report.is_record:
        return report.breaks
    return replace(
        report.breaks, frames=link.frames, skipped_bytes=link.skipped_bytes, bad_crc=link.bad_crc,
        unknown=link.unknown, lost=link.lost, unsigned_rejected=link.unsigned_rejected,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Basis:
    """What the verdict on a stream needs besides its estimates.

    ``reasons`` are those of the log; ``rates_hz`` are the rates of yaw and rudder messages, None
    where there are no estimates to judge.
    """

    reasons: list[Reason]
    rates_hz: tuple[float, float] | None = None

    def verdict(self, bank: Bank, evidence: dict[str, Evidence]) -> Verdict:
        """Return the verdict on the stream that ``bank`` has seen."""
        if self.rates_hz is None:
            return Verdict.of(self.reasons)
        return bank_verdict(bank, evidence, self.rates_hz, self.reasons)


def basis_of(pipeline: Finished, link: LinkStats) -> Basis:
    """Return the reasons found in link and channels; this is cheap at any time of a run."""
    return _basis(pipeline, pipeline.report(), link)


def _basis(pipeline: Finished, report: ChannelReport, link: LinkStats) -> Basis:
    if missing := list(_missing(report, link)):
        return Basis(missing)
    believed = partial(why_believed, pipeline.config, pipeline.bank)
    found = [Reason(*each) for each in (*report.commands(believed), *report.reasons)]
    if pipeline.bank is None or report.rates_hz is None:
        text = f"no stretch has both rudder and yaw rate for the {WINDOW_S:g} s an estimate needs"
        return Basis([*found, Reason("not_excited", text)])
    if report.used == 0:
        why = ", ".join(words(flag) for flag in report.held)
        cures = {Held.ON_GROUND: IF_IT_FLEW, Held.RUDDER_INVALID: NO_VALUE}
        cure = "".join(f"; {said}" for flag, said in cures.items() if flag in report.held)
        found.append(Reason("not_excited", f"every sample is held: {why}{cure}"))
    found += changed_rates(*report.rates_hz, *report.later_hz)
    return Basis(found, report.rates_hz)


def _missing(report: ChannelReport, link: LinkStats) -> Iterator[Reason]:
    """Yield what is missing of vehicle, rudder and yaw; if one is, there is nothing to judge."""
    if report.vehicle is None and not report.is_record:
        rejected = link.unsigned_rejected
        keyed = (
            f"; {rejected} frames were rejected, as they are not signed with the key"
            if rejected
            else ""
        )
        nothing = "no MAVLink frame was received: check the address or the file"
        why = report.why_no_vehicle if link.frames or rejected else nothing
        yield Reason("no_vehicle", why + keyed)
    yield from (Reason(*each) for each in report.missing)


def bank_summaries(bank: Bank) -> tuple[dict[str, MethodSummary], dict[str, Evidence]]:
    """Return, by method, the summary of a stream and the evidence that the verdict needs."""
    history = bank.history()
    earlier, spread = _shortly_before(bank, history), stream_spread(bank, history)
    summaries, evidence = {}, {}
    for method in bank.methods:
        before = np.full(2, np.nan)
        if earlier is not None:
            before = dutch_roll_in(bank, method, earlier.theta[method])
        held_back_pct = _held_back_pct(bank, method, history)
        summaries[method], evidence[method] = described(
            bank, method, history, held_back_pct, before, spread
        )
    return summaries, evidence


def described(
    bank: Estimates,
    method: str,
    history: SampleHistory,
    held_back_pct: float,
    before: Floats,
    spread: Spread,
) -> tuple[MethodSummary, Evidence]:
    """Return the summary of one method, and the evidence that the verdict needs.

    ``held_back_pct`` is the fit of samples that the model had not seen; ``before`` holds earlier
    wn and zeta, NaN where unknown; ``spread`` gives the sigma that noise does not explain.
    """
    estimator, last = bank.estimators[method], bank.last[method]
    orders, sample_time_s = estimator.config.orders, bank.sample_time_s
    found = modes_in(bank, method)
    noise, theta = found.dutch_roll[-1], last.theta[-1]
    wn, wn_noise, zeta, zeta_noise = noise.tolist()
    spread = spread.around(wn)
    pairs = (("wn_rad_s", wn, wn_noise), ("zeta", zeta, zeta_noise))
    total = np.array([spread.total(method, *pair) for pair in pairs])
    physics = _physics(bank, method, noise, spread)
    fit = _fit(bank, method, history) | {"simulation_held_back_pct": held_back_pct}
    names = parameter_names(orders, bank.config.inputs, bias=estimator.config.bias)
    described = MethodSummary(
        method=method,
        orders=Orders(orders.na, orders.nb[0], orders.nc, orders.nk[0]),
        sample_time_s=sample_time_s,
        forgetting_factor=estimator.config.forgetting_factor,
        updates=estimator.updates,
        held=estimator.held,
        theta=finite(dict(zip(names, theta, strict=True))),
        theta_std=finite(dict(zip(names, last.theta_std[-1], strict=True))),
        modes=[Mode(**each) for each in mode_list(found)],
        dutch_roll=DutchRoll.of(
            (wn, total[0], zeta, total[1]), (wn_noise, zeta_noise), has_level=True
        ),
        physics={n: _value(method, n, each, spread) for n, each in physics.items()} or None,
        fit=Fit(**finite(fit)),
    )
    evidence = Evidence(
        status=int(last.status[-1]),
        updates=estimator.updates,
        dutch_roll=noise,
        total_std=total,
        next_moves=spread.next_moves(wn, zeta),
        rate_moves=spread.rate_moves(wn, zeta),
        whiteness_p=estimator.whiteness_p,
        autocorrelation=largest_autocorrelation((history.y - history.y_hat[method])[-NEWEST:]),
        spr_margin=fit["spr_margin"],
        early_response=early_response(theta, orders, sample_time_s, wn),
        simulation_pct=fit["simulation_pct"],
        held_back_pct=held_back_pct,
        before=before,
    )
    return described, evidence


def _physics(
    bank: Estimates, method: str, dutch_roll: Floats, spread: Spread
) -> dict[str, dict[str, float]]:
    """Return the numbers of eq. 22-23 of an estimate, with sigmas of noise; empty without any."""
    estimator = bank.estimators[method]
    found = summary_of(
        bank.last[method].theta[-1], estimator.covariance, estimator.config.orders,
        bank.sample_time_s, mean_output=bank.config.output == "yaw",
        servo_tau_s=bank.config.servo_tau,
    )  # fmt: skip
    if not found and METHODS[method].runs_free and (found := spread.two_poles()):
        wn, wn_std, zeta, zeta_std = dutch_roll.tolist()
        found["omega_beta"] = {"value": wn, "std": wn_std}
        found["xi_beta"] = {"value": zeta, "std": zeta_std}
    return found


def _value(method: str, name: str, each: dict[str, float], spread: Spread) -> Value:
    """Return a number of eq. 22-23 with both its sigmas; the error of the reduction has none."""
    if name == REDUCTION_ERROR:
        return Value(**each)
    total = spread.total(method, name, each["value"], each["std"])
    return Value(value=each["value"], std=total, std_noise=each["std"])


def stream_spread(bank: Bank, history: SampleHistory) -> Spread:
    """Return the spread around the stream's answers, from its newest two memories of samples.

    One fit to all of these samples, with the estimators' own orders, is one of the structures: a
    recursion may not yet have reached the values that its samples lead to.
    """
    found = (dutch_roll_in(bank, method, bank.last[method].theta[-1])[0] for method in bank.methods)
    wn = next((float(each) for each in found if each > 0.0), math.nan)
    if not math.isfinite(wn):
        return NOTHING_KNOWN
    forgotten = 1.0 - bank.config.forgetting_factor(bank.sample_time_s)
    rows = min(NEWEST, math.ceil(SPREAD_MEMORIES / forgotten) if forgotten > 0.0 else NEWEST)
    u, y = history.u[-rows:], history.y[-rows:]
    return spread_of(bank.config, bank.sample_time_s, u, y, wn)


def modes_in(bank: Estimates, method: str) -> ModesBlock:
    """Return the modes of a method's last estimate, with sigmas of noise, as a block of one row."""
    orders, mean_output = bank.estimators[method].config.orders, bank.config.output == "yaw"
    return modes(bank.last[method], orders, bank.sample_time_s, mean_output=mean_output)


def dutch_roll_in(bank: Estimates, method: str, theta: Floats) -> Floats:
    """Return wn in rad/s and zeta (2,) of the Dutch roll in a method's theta (p,), NaN without."""
    orders, mean_output = bank.estimators[method].config.orders, bank.config.output == "yaw"
    return dutch_roll_of(theta, orders, bank.sample_time_s, mean_output=mean_output)


def _fit(bank: Estimates, method: str, history: SampleHistory) -> dict[str, float]:
    estimator = bank.estimators[method]
    theta, config = bank.last[method].theta[-1], estimator.config
    y, y_hat = history.y, history.y_hat[method]
    if METHODS[method].runs_free:
        simulated = y_hat
    else:
        simulated = simulate(theta, config.orders, config.bias, history.u, y)
    return {
        "one_step_pct": fit_percent(y, y_hat),
        "simulation_pct": fit_percent(y, simulated),
        "innovation_std": estimator.innovation_std,
        "residual_std": estimator.residual_std,
        "whiteness_p": estimator.whiteness_p,
        "spr_margin": spr_margin(c_of(estimator.theta, config.orders)),
    }


def _held_back_pct(bank: Bank, method: str, history: SampleHistory) -> float:
    """Return the fit of the model as it stood at two thirds, run free over the last third.

    NaN where there is too little data, or where the rudder rests in the last third: no model
    explains noise alone. The samples are those of the history, 2^19 at most: the whole run if
    nothing is forgotten, else the newest three memories. So the memory used stays bounded, however
    long a run or a session lasts.
    """
    good = history.good
    if len(good) < LEAST_SAMPLES:
        return math.nan
    earlier = bank.earlier(int(good[int(TRAINING * len(good))]))
    if earlier is None or not earlier.theta[method].any():
        return math.nan
    config, rows = bank.estimators[method].config, slice(earlier.first, None)
    u, y = history.u[rows], history.y[rows]
    moved, least = u[np.isfinite(u[:, 0]), 0], LEAST_STROKE * bank.config.half_travel
    if len(moved) == 0 or strokes(moved, window_of(bank.sample_time_s)).max() < least:
        return math.nan
    return fit_percent(y, simulate(earlier.theta[method], config.orders, config.bias, u, y))


def _shortly_before(bank: Bank, history: SampleHistory) -> PastModels | None:
    """Return the models a third of the memory ago, or before the last third of a short record."""
    good = history.good
    if len(good) < LEAST_SAMPLES:
        return None
    forgotten = 1.0 - bank.config.forgetting_factor(bank.sample_time_s)
    back = (1.0 - TRAINING) * min(len(good), 1.0 / forgotten if forgotten > 0.0 else math.inf)
    return bank.earlier(int(good[-math.ceil(back)]))
