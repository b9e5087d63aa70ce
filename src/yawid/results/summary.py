"""The summary of a run: what ``--json`` prints, its verdict, and the estimates of its stream."""

from collections.abc import Iterator
from functools import partial
from typing import Protocol

from msgspec.structs import replace

from yawid.answers.channel_report import ChannelReport
from yawid.answers.heard import LinkCounts
from yawid.answers.model_parts import Fit, Mode
from yawid.answers.ordinary import ORDINARY, OrdinaryAnswer
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import (
    Bare,
    DutchRoll,
    Flight,
    Manoeuvre,
    MethodSummary,
    Orders,
    RunSummary,
    Value,
)
from yawid.blocks import WINDOW_S, ModesBlock, finite
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank, SampleHistory
from yawid.estimation.fit import fit_percent, simulate
from yawid.estimation.polynomials import c_of, parameter_names, spr_margin
from yawid.physics.derivatives import summary_of
from yawid.physics.modes import mode_list, modes
from yawid.quantities.link import LinkStats
from yawid.quantities.table import REDUCTION_ERROR
from yawid.results.advice import advised
from yawid.results.judge_samples import (
    changed_rates,
    message_rate_reasons,
    why_believed,
)
from yawid.results.ordinary_flight import compared, why_unknown
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

    def flights(self, of_the_log: list[Reason]) -> list[Flight]:
        """Return the flight's answers, the headline first; none where there is no manoeuvre."""

    def why_none(self) -> list[Reason]:
        """Return why there is no estimate, or no manoeuvre, by what the samples showed."""

    def bare(self) -> Bare | None:
        """Return the bare airframe of all its manoeuvres, None where none was looked for."""

    def ordinary(self) -> OrdinaryAnswer | None:
        """Return the answer of ordinary flight, None where none was asked for."""


def summarise(pipeline: Finished, link: LinkStats, log: str, sha256: str) -> RunSummary:
    """Return the summary of a finished pipeline.

    ``link`` holds the counts of what was read; ``log`` and ``sha256`` identify the file.
    """
    bank, report = pipeline.bank, pipeline.report()
    is_estimated = bank is not None and report.rudder_message is not None
    summary = RunSummary(
        log=log,
        sha256=sha256,
        duration_s=max((link.last_us or 0) - (link.first_us or 0), 0) / 1e6,
        vehicle=report.vehicle,
        vehicles=report.vehicles if len(report.vehicles) > 1 else None,
        boots=report.boots if len(report.boots) > 1 else None,
        link=_link(link, report),
        channels=dict(report.channels),
        estimates=of_stream(bank) if bank is not None and is_estimated else None,
        manoeuvres=pipeline.manoeuvres,
        bare=pipeline.bare(),
        ordinary=pipeline.ordinary(),
    )
    return judged(summary, pipeline, log_reasons(pipeline, report, link), report.rates_hz)


def judged(
    summary: RunSummary,
    pipeline: Finished,
    of_the_log: list[Reason],
    rates_hz: tuple[float, float] | None,
) -> RunSummary:
    """Return the summary with its verdict, the flight's answers, and what to do.

    ``of_the_log`` are the reasons found in link and channels, ``rates_hz`` the rates of yaw and
    rudder messages, None where there are none.
    """
    flights = pipeline.flights(of_the_log)
    verdict = verdict_of(pipeline, of_the_log, rates_hz, flights, summary.ordinary)
    summary = replace(
        summary,
        estimates=None if pipeline.config.ordinary == "only" else summary.estimates,
        verdict=verdict,
        warnings=of_the_log or None if verdict is None else None,
        flight=flights[0] if flights else None,
        flights=[flight for flight in flights if flight.used] or None,
    )
    return advised(with_yaw_loop(compared(summary)))


def verdict_of(
    pipeline: Finished,
    of_the_log: list[Reason],
    rates_hz: tuple[float, float] | None,
    flights: list[Flight],
    ordinary: OrdinaryAnswer | None,
) -> Verdict | None:
    """Return the one verdict of a run: the flight's, or why the log has no answer.

    With ``--ordinary only`` it is that of ordinary flight. None where no manoeuvres were searched
    for and the log lacks nothing: it is not judged.
    """
    if flights:
        return flights[0].verdict
    rates = () if rates_hz is None else message_rate_reasons(*rates_hz)
    if pipeline.config.ordinary == "only":
        return Verdict.of([*of_the_log, *rates, *why_unknown(ordinary)], ORDINARY)
    verdict = Verdict.of([*of_the_log, *rates, *pipeline.why_none()])
    return None if pipeline.manoeuvres is None and verdict.usable else verdict


def _link(link: LinkStats, report: ChannelReport) -> LinkCounts:
    if report.is_record:
        return report.breaks
    return replace(
        report.breaks, frames=link.frames, skipped_bytes=link.skipped_bytes, bad_crc=link.bad_crc,
        unknown=link.unknown, lost=link.lost, unsigned_rejected=link.unsigned_rejected,
    )  # fmt: skip


def log_reasons(pipeline: Finished, report: ChannelReport, link: LinkStats) -> list[Reason]:
    """Return the reasons found in link and channels; this is cheap at any time of a run."""
    if missing := list(_missing(report, link)):
        return missing
    believed = partial(why_believed, pipeline.config, pipeline.bank)
    found = [*report.commands(believed), *report.reasons]
    if pipeline.bank is None or report.rates_hz is None:
        text = f"no stretch has both rudder and yaw rate for the {WINDOW_S:g} s an estimate needs"
        return [*found, Reason("not_excited", text)]
    return [*found, *changed_rates(*report.rates_hz, *report.later_hz)]


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
    yield from report.missing


def of_stream(bank: Bank) -> dict[str, MethodSummary]:
    """Return what each method has estimated from the stream at its end.

    Its sigmas are those of P, of noise alone: what the structure leaves out is not in them.
    """
    history = bank.history()
    return {method: _of_method(bank, method, history) for method in bank.methods}


def dutch_roll_of_stream(bank: Bank, method: str) -> DutchRoll | None:
    """Return the newest Dutch roll of a method, with P's sigma; None where its model has none."""
    row = _modes(bank, method).dutch_roll[-1].tolist()
    return DutchRoll.of(row, row[1::2])


def _modes(bank: Bank, method: str) -> ModesBlock:
    orders, mean_output = bank.estimators[method].config.orders, bank.config.output == "yaw"
    return modes(bank.last[method], orders, bank.sample_time_s, mean_output=mean_output)


def _of_method(bank: Bank, method: str, history: SampleHistory) -> MethodSummary:
    estimator, last = bank.estimators[method], bank.last[method]
    orders, theta = estimator.config.orders, last.theta[-1]
    numbers = summary_of(
        theta, estimator.covariance, orders, bank.sample_time_s,
        mean_output=bank.config.output == "yaw",
    )  # fmt: skip
    error = numbers.pop(REDUCTION_ERROR, None)
    physics = {n: Value(x["value"], x["std"], x["std"]) for n, x in numbers.items()}
    simulated = simulate(theta, orders, estimator.config.bias, history.u, history.y)
    fit = {
        "one_step_pct": fit_percent(history.y, history.y_hat[method]),
        "simulation_pct": fit_percent(history.y, simulated),
        "innovation_std": estimator.innovation_std,
        "residual_std": estimator.residual_std,
        "whiteness_p": estimator.whiteness_p,
        "spr_margin": spr_margin(c_of(estimator.theta, orders)),
    }
    names = parameter_names(orders, bank.config.inputs, bias=estimator.config.bias)
    return MethodSummary(
        method=method,
        orders=Orders(orders.na, orders.nb[0], orders.nc, orders.nk[0]),
        sample_time_s=bank.sample_time_s,
        forgetting_factor=estimator.config.forgetting_factor,
        updates=estimator.updates,
        held=estimator.held,
        theta=finite(dict(zip(names, theta, strict=True))),
        theta_std=finite(dict(zip(names, last.theta_std[-1], strict=True))),
        modes=[Mode(**each) for each in mode_list(_modes(bank, method))],
        dutch_roll=dutch_roll_of_stream(bank, method),
        physics=physics | ({} if error is None else {REDUCTION_ERROR: Value(**error)}) or None,
        fit=Fit(**finite(fit)),
    )
