"""``yawid inspect``: whether a log is usable, its channels, rates and excited stretches.

Where it is not usable the answer lists what to record next time. It comes from a replay without
outputs, whose verdict it has.
"""

import shlex
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from yawid.answers.flight_test_card import FlightTestCard
from yawid.answers.inspection import Answerable, Can, Inspection, MessageRate, Span
from yawid.answers.run_summary import Origin, RunSummary
from yawid.blocks import Floats, Ints, SampleBlock
from yawid.channels.segments import REBOOT_US, Boots
from yawid.channels.survey import Survey
from yawid.config.run import RATE_SLACK, RunConfig, option_name, settings_declared
from yawid.quantities.link import SenderStats
from yawid.results.advice import what_to_record
from yawid.results.excitation import excitation
from yawid.results.judge_samples import LEAST_RATE_HZ
from yawid.results.make_card import Flown, make_card, why_no_card
from yawid.runs.can import what_it_can
from yawid.runs.job import KeptSamples, RecordedLog, run
from yawid.sinks.terminal.progress import Bar, progress
from yawid.sources.open_log import ReadOptions
from yawid.system.stores import Place

BRIDGE_S = 20.0
"""Excited stretches that are no more than this far apart are joined to one."""
BEFORE_S = 2.0
"""A stretch begins this long before the rudder moves."""
LEAST_STRETCH_S = 5.0
WORTH_SAYING = frozenset({"rudder_assumed", "unit_assumed", "rate_low"})
"""Warnings for which the answer says how the next recording can avoid them."""
LEAST_PER_PERIOD, GOOD_PER_PERIOD = 4.0, 10.0
"""Messages per period of the Dutch roll: at least the first for an answer, better the second."""
TAP = "udpin:127.0.0.1:14560"
"""The endpoint of the test card's live command: a ground station has to forward its link there."""


def inspect(
    log: Path,
    settings: Mapping[str, Any],
    read_options: ReadOptions | None = None,
    *,
    with_card: bool = False,
) -> Inspection:
    """Return what a log can answer, as ``yawid inspect --json`` prints it.

    Its verdict is that of a replay as asked for, and its command is that replay.

    Raises:
        SourceError: the log cannot be read.
        ConfigError: what is asked for does not fit the log.
    """
    source = RecordedLog(log, read_options)
    config = source.settled(settings)
    with progress(sys.stderr, log.name, source.size) as bar:
        return _inspected(source, config, bar, with_card=with_card)


def _inspected(source: RecordedLog, config: RunConfig, bar: Bar, *, with_card: bool) -> Inspection:
    kept, survey = KeptSamples(), Survey()
    job = run(source, config, [kept], advance=bar, survey=survey)
    log, link, channels = source.path, source.link, job.pipeline.channels
    summary, samples, rates = job.conclude(), kept.joined(), survey.rates()
    found: list[Span] = []
    if samples is not None and channels.surfaces:
        found = stretches(samples, config, channels.boots)
    reasons = summary.deciding.reasons
    ids = [r.id for r in reasons if r.exit_code or r.id in WORTH_SAYING]
    origin = {name: getattr(summary, name) for name in Origin.__struct_fields__}
    counted = {key: SenderStats(n) for key, n in link.senders.items()} | dict(link.by_sender)
    modes_of, parameters = channels.modes_of, channels.parameters.values
    can = what_it_can(summary, job.pipeline)
    can_answer = summary.flight is not None or summary.verdict is None
    return Inspection(
        **origin | {"link": structs.replace(summary.link, signed=link.signed or None)},
        senders={f"{s}/{c}": n for (s, c), n in link.senders.items()},
        by_sender={f"{s}/{c}": asdict(n) for (s, c), n in counted.items()},
        unchecked=source.options.unchecked(link),
        rates=rates,
        answerable=_answerable(rates),
        phases=None if modes_of is None else survey.phases(*modes_of),
        excited=found,
        manoeuvres=summary.manoeuvres,
        flight=summary.flight,
        flights=summary.flights,
        can=can,
        record=what_to_record(ids, job.pipeline.report()) or None,
        command=command_line(log, config, source.options) if can_answer else None,
        card=_card(summary, can, config, samples, rates, parameters) if with_card else None,
        verdict=summary.verdict,
        warnings=summary.warnings,
    )


def _card(
    summary: RunSummary,
    can: Mapping[str, Can],
    config: RunConfig,
    samples: SampleBlock | None,
    rates: Mapping[str, MessageRate],
    known: Mapping[str, float],
) -> FlightTestCard | None:
    """Return the flight test card, None for a vehicle for which no card can be made."""
    if why_no_card(summary.vehicle, summary.deciding) is not None:
        return None
    flown = Flown() if samples is None else Flown.of(samples)
    rates_hz = {name: each.rate_hz for name, each in rates.items()}
    live = None
    if summary.vehicle is not None:
        words = _words(replace(config, from_s=None, to_s=None, boot=None))
        live = shlex.join(["yawid", "live", TAP, *words])
    return make_card(summary, can, flown, rates_hz, known, config.rudder_max_deg, live)


def command_line(log: Place, config: RunConfig, read_options: ReadOptions) -> str:
    """Return the command that replays a log with this configuration, to be copied into a shell.

    An option at its default is left out unless the user gave it: a given option is binding for
    every manoeuvre.
    """
    words = ["yawid", "replay", str(log), *_words(config)]
    if read_options.key_file is not None:
        words += ["--signing-key-file", str(read_options.key_file)]
    return shlex.join(words)


def _words(config: RunConfig) -> list[str]:
    """Return the options that differ from their defaults, and those that the user gave."""
    found = list[str]()
    for option, _ in settings_declared():
        value = getattr(config, option.name)
        is_usual = value == option.default and option.name not in config.given
        if value is None or is_usual:
            continue
        text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
        found += [f"--{option_name(option.name)}", text]
    return found


def _answerable(rates: Mapping[str, MessageRate]) -> Answerable | None:
    """Return the fastest Dutch rolls that the slower rate can answer, None if it is too low."""
    slowest_hz = min((each.rate_hz for each in rates.values()), default=0.0)
    if len(rates) < 2 or slowest_hz < LEAST_RATE_HZ * RATE_SLACK:
        return None
    most_rad_s = 2.0 * np.pi * slowest_hz
    return Answerable(most_rad_s / LEAST_PER_PERIOD, most_rad_s / GOOD_PER_PERIOD)


def stretches(samples: SampleBlock, config: RunConfig, boots: Boots) -> list[Span]:
    """Return the stretches in which the rudder moved on its own, measured as the verdict does.

    Stretches near each other are joined; a reboot and a change of flight mode end a stretch.
    """
    t_s, mode = samples.boot_us / 1e6, samples.mode
    rudder = np.where(np.isfinite(samples.y), samples.u[:, 0], np.nan)
    sample_time_s = samples.sample_time_s
    moved = excitation(rudder, samples.aileron, mode, config.half_travel, sample_time_s)
    numbers = _boot_numbers(t_s, boots)
    known = np.where(np.isnan(mode), -1.0, mode)
    meaning = np.cumsum(
        (np.diff(numbers, prepend=numbers[0]) != 0) | (np.diff(known, prepend=known[0]) != 0)
    )
    return [
        stretch
        for rows in np.split(np.arange(len(t_s)), np.flatnonzero(np.diff(meaning)) + 1)
        for stretch in _joined(t_s[rows], int(numbers[rows[0]]), moved.excited[rows])
    ]


def _boot_numbers(t_s: Floats, boots: Boots) -> Ints:
    """Return the number of each sample's boot (n,), from the times since boot (n,) in s.

    Boots are counted from 1. One without samples is skipped, found by the times each boot covers.
    """
    runs = np.cumsum(np.diff(t_s, prepend=t_s[0]) < -REBOOT_US / 1e6)
    numbers = np.ones(len(t_s), np.int64)
    spans = iter(sorted(boots.spans_us.items()))
    for number in range(int(runs[-1]) + 1):
        rows = runs == number
        first, last = 1e6 * float(t_s[rows].min()), 1e6 * float(t_s[rows].max())
        within = (n for n, (a, b) in spans if a - REBOOT_US <= first and last <= b + REBOOT_US)
        numbers[rows] = next(within, number + 1)
    return numbers


def _joined(t_s: Floats, boot: int, excited: Any) -> Iterator[Span]:
    """Yield the excited stretches of one boot and flight mode; short rests do not end a stretch."""
    rows = np.flatnonzero(excited)
    for part in np.split(rows, np.flatnonzero(np.diff(t_s[rows]) > BRIDGE_S) + 1):
        if len(part):
            first, last = max(float(t_s[part[0]]) - BEFORE_S, float(t_s[0])), float(t_s[part[-1]])
            if last - first >= LEAST_STRETCH_S:
                yield Span(boot, round(first, 1), round(last, 1))
