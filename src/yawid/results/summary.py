"""The summary of a run: everything ``--json`` prints, and the verdict it carries."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

from msgspec import convert
from msgspec.structs import replace

from yawid.blocks import words
from yawid.channels.find_surface import why_no_surface
from yawid.channels.grid_rate import RATE_TOLERANCE
from yawid.channels.parameters import STOCK_TRAVEL_US
from yawid.channels.stage import Channels
from yawid.channels.surface import STICKS, Surface
from yawid.channels.surface_reader import LEAST_SHARE, TOLERANCE, Twins
from yawid.channels.yaw_reader import COARSE, SOURCES
from yawid.config.run import RunConfig
from yawid.estimation.bank import Bank
from yawid.results.estimate_summary import method_summary
from yawid.results.judge import bank_verdict
from yawid.results.judge_estimate import Evidence
from yawid.results.judge_samples import changed_rates
from yawid.results.reasons import Reason, Verdict
from yawid.results.run_summary import (
    BootSpan,
    ChannelFound,
    LinkCounts,
    MethodSummary,
    ReasonSummary,
    RunSummary,
    VehicleSeen,
    VerdictSummary,
)
from yawid.sources.mavlink.link_stats import LinkStats


class Finished(Protocol):
    """What is summarised of a finished run: channels, estimators, configuration."""

    @property
    def channels(self) -> Channels:
        """The channels, at the end of the log."""

    @property
    def bank(self) -> Bank | None:
        """The estimators, None where there was no sample."""

    @property
    def config(self) -> RunConfig:
        """What was asked for."""


def summarise(
    pipeline: Finished, link: LinkStats, log: str, sha256: str
) -> tuple[RunSummary, Verdict]:
    """Return the summary of a finished pipeline and its verdict; ``link`` counts what was read."""
    channels, bank = pipeline.channels, pipeline.bank
    vehicle, vehicles = channels.lock.vehicle, channels.lock.vehicles
    boots = [
        BootSpan(boot=number, from_s=first / 1e6, to_s=last / 1e6)
        for number, (first, last) in channels.boots.spans_us.items()
    ]
    estimates: dict[str, MethodSummary] = {}
    evidence: dict[str, Evidence] = {}
    has_estimates = bank is not None and bool(channels.surfaces)
    if bank is not None and channels.surfaces:
        for method in bank.methods:
            estimates[method], evidence[method] = method_summary(bank, method)
    verdict = _verdict(pipeline, link, evidence)
    summary = RunSummary(
        log=log,
        sha256=sha256,
        duration_s=max((link.last_us or 0) - (link.first_us or 0), 0) / 1e6,
        vehicle=None if vehicle is None else convert(vehicle, VehicleSeen, from_attributes=True),
        vehicles=convert(vehicles, list[VehicleSeen]) if len(vehicles) > 1 else None,
        boots=boots if len(boots) > 1 else None,
        link=_link(link, channels),
        channels=_channels(channels),
        estimates=estimates if has_estimates else None,
        verdict=as_summary(verdict),
    )
    return summary, verdict


def as_summary(verdict: Verdict) -> VerdictSummary:
    """Return the verdict as ``--json`` prints it."""
    reasons = [ReasonSummary(r.id, r.weight, r.text) for r in verdict.reasons]
    return VerdictSummary(method=verdict.method, usable=verdict.usable, reasons=reasons)


def _link(link: LinkStats, channels: Channels) -> LinkCounts:
    segmenter, aligner = channels.segmenter, channels.aligner
    return LinkCounts(
        frames=link.frames,
        skipped_bytes=link.skipped_bytes,
        bad_crc=link.bad_crc,
        unknown=link.unknown,
        lost=link.lost,
        reboots=segmenter.reboots,
        clock_steps=segmenter.clock_steps,
        gaps=segmenter.silences + (0 if aligner is None else aligner.gaps),
        unsigned_rejected=link.unsigned_rejected,
        clock_leap_s=segmenter.leap_us / 1e6 if segmenter.leap_us else None,
    )


def _channels(channels: Channels) -> dict[str, ChannelFound]:
    yaw_rate, surface_rate = _rates(channels)
    found = {
        name: _surface(surface, channels.twins, surface_rate)
        for name, surface in zip(channels.config.inputs, channels.surfaces, strict=False)
    }
    if channels.yaw.rows:
        found["yaw"] = replace(yaw_rate, source=channels.yaw.label)
    return found


def _rates(channels: Channels) -> list[ChannelFound]:
    """Return what to say of the message rates of yaw and surfaces, without their names.

    ``rate_hz`` is that of the first seconds, which chose the grid, unless the whole run's is
    another by more than their jitter: then it is the whole run's, and the other one stands beside
    it.
    """
    if channels.intervals_us is None:
        return [ChannelFound(""), ChannelFound("")]
    told = []
    for flow, interval_us in zip(channels.flows, channels.intervals_us, strict=True):
        first_hz, whole_hz = 1e6 / interval_us, flow.rate_hz
        if abs(whole_hz - first_hz) > (RATE_TOLERANCE - 1.0) * first_hz:
            told.append(ChannelFound("", rate_hz=whole_hz, first_rate_hz=first_hz))
        else:
            told.append(ChannelFound("", rate_hz=first_hz))
    return told


def _surface(surface: Surface, twins: Twins, rate: ChannelFound) -> ChannelFound:
    found = replace(rate, source=surface.source, how=twins.how(surface))
    first = surface.parts[0]
    if first.travel_us is None:
        return found
    low, trim, high = first.travel_us
    return replace(found, min_us=low, trim_us=trim, max_us=high, reversed=first.reversed)


def _verdict(pipeline: Finished, link: LinkStats, evidence: dict[str, Evidence]) -> Verdict:
    channels, bank = pipeline.channels, pipeline.bank
    missing = list(_missing(pipeline, link))
    if missing:
        return Verdict.of(missing)
    found = [Reason(*said) for said in channels.command.texts(channels.lock.vehicle)]
    found += _surface_reasons(channels)
    if bank is None or channels.intervals_us is None:
        text = "rudder and yaw rate never flow together for as long as an answer needs"
        return Verdict.of([*found, Reason("not_excited", text)])
    if channels.used == 0:
        why = ", ".join(words(flag) for flag in channels.held)
        found.append(Reason("not_excited", f"every sample is held: {why}"))
    yaw_hz, rudder_hz = (1e6 / interval for interval in channels.intervals_us)
    found += changed_rates(yaw_hz, rudder_hz, *(flow.rate_hz for flow in channels.flows))
    travel_unit = abs(channels.surfaces[0].scale)
    return bank_verdict(bank, evidence, (yaw_hz, rudder_hz), travel_unit, found)


def _missing(pipeline: Finished, link: LinkStats) -> Iterator[Reason]:
    """Yield what is missing of vehicle, rudder and yaw: without one there is nothing to judge."""
    channels, config = pipeline.channels, pipeline.config
    vehicle = channels.lock.vehicle
    if vehicle is None:
        rejected = link.unsigned_rejected
        keyed = f"; {rejected} frames were rejected by the signing key" if rejected else ""
        nothing = "not one MAVLink frame came: is it the right address or file?"
        why = channels.lock.why_none() if link.frames or rejected else nothing
        yield Reason("no_vehicle", why + keyed)
        return
    # Without a yaw source no servo message has a time: that is no_yaw, not no_rudder.
    unheard = channels.surface_rows == 0 and channels.yaw.rows > 0
    if unheard or not channels.surfaces:
        missing = "rudder" if config.inputs == ("rudder",) else " or ".join(config.inputs)
        if channels.surfaces:
            text = f"no message carries {channels.surfaces[0].source}"
        else:
            text = why_no_surface(missing, vehicle, channels.parameters)
        yield Reason("no_rudder", text)
    if channels.yaw.rows == 0:
        yield Reason("no_yaw", f"none of {', '.join(SOURCES)} comes from the vehicle")


def _surface_reasons(channels: Channels) -> list[Reason]:
    """Return what is said of the channels, all texts of one id in one reason."""
    texts: dict[str, list[str]] = {}
    if channels.yaw.source in COARSE:
        text = f"the yaw rate is made from {channels.yaw.label}: coarse and slow"
        texts["channel_stand_in"] = [text]
    for name, surface in zip(channels.config.inputs, channels.surfaces, strict=True):
        for id_, text in _surface_texts(name, surface, channels.twins):
            texts.setdefault(id_, []).append(text)
    return [Reason(id_, "; ".join(found)) for id_, found in texts.items()]


def _surface_texts(name: str, surface: Surface, twins: Twins) -> Iterator[tuple[str, str]]:
    if "assumed" in surface.how:
        low, trim, high = surface.parts[0].travel_us or STOCK_TRAVEL_US
        yield (
            "rudder_assumed",
            f"the log does not say which channel moves the {name}, or how far: "
            f"{surface.source} with {low:g}/{trim:g}/{high:g} us is assumed",
        )
    for twin in surface.twins:
        share = twins.share_apart(surface, twin)
        if share > LEAST_SHARE:
            yield (
                "rudder_assumed",
                f"{surface.name_of(twin)} is a {name} too and differs from {surface.source} by "
                f"more than {100 * TOLERANCE:.0f} % of half the travel in {100 * share:.0f} % of "
                f"the messages: {surface.source} is assumed",
            )
    if surface.message in STICKS:
        yield "channel_stand_in", f"{surface.source} is the pilot's stick, not the {name} itself"
