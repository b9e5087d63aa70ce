"""What a log can give, a row each: what is there already, or what is known before any fit.

flown -> bare (its airframe without the autopilot), and the advice on the yaw damper
ordinary (the mode from flight without a manoeuvre) by itself
"""

import math
from collections.abc import Iterable
from typing import Final, TypeAlias

from yawid.answers.inspection import Can
from yawid.answers.ordinary import ORDINARY
from yawid.answers.reasons import ask_for
from yawid.answers.run_summary import RunSummary
from yawid.damper.refusals import refusals
from yawid.lateral.gates import GATES, not_driven, too_slow
from yawid.pipeline import Pipeline
from yawid.quantities.vehicles import AIRFRAME
from yawid.results.advice import what_to_record
from yawid.results.make_card import NICE_HZ
from yawid.results.yaw_loop import damped_by

Lack: TypeAlias = tuple[str, str]
"""What was found and what is needed, and what to do about it."""
NOT_SOUGHT: Final = "manoeuvres were not looked for", "leave out --manoeuvres off, --ordinary only"
NOT_ASKED: Final = "ordinary flight was not looked at", "give --ordinary auto"
NOT_FLOWN: Final = "there is no usable answer as flown", ""
NO_SAMPLES: Final = "there is no sample: it lacks what the answer as flown lacks", ""


def what_it_can(summary: RunSummary, pipeline: Pipeline) -> dict[str, Can]:
    """Return what a log that was read to its end can give, and what it lacks for each.

    A row without an answer says yes where nothing known before the fit speaks against it.
    """
    config, report, known = pipeline.config, pipeline.report(), pipeline.channels.parameters.values
    bare, ordinary, fatal = summary.bare, summary.ordinary, summary.deciding.fatal
    facts = list(facts_of_bare(pipeline).values())
    if bare is not None and not facts:
        facts = [("; ".join(x.text for x in bare.verdict.reasons), bare.verdict.next or "")]
    flown = [(x.text, " ".join(what_to_record([x.id], report)) or x.remedy or "") for x in fatal]
    rows: dict[str, Iterable[Lack]] = {
        "flown": flown if config.has_manoeuvres else [NOT_SOUGHT],
        "bare": [] if bare else facts,
        ORDINARY: [NO_SAMPLES if config.is_ordinary else NOT_ASKED]
        if ordinary is None
        else [(each.text, each.remedy or "") for each in ordinary.verdict.fatal],
        "damper": [
            NOT_FLOWN if x.reason.id == "not_usable" else (x.reason.text, x.to_do)
            for x in refusals(summary, config, known)
        ],
    }
    lacks = {name: list(dict.fromkeys(map(_sentence, row))) for name, row in rows.items()}
    return {name: Can(not each, each) for name, each in lacks.items()}


def _sentence(lack: Lack) -> str:
    """Return what was found and needed with what to do about it, unless it says that already."""
    text, to_do = lack[0], lack[1].rstrip(".")
    if not to_do or to_do.lower() in text.lower():
        return text
    return f"{text}; {to_do[0].lower() if to_do[1:2].islower() else to_do[0]}{to_do[1:]}"


def facts_of_bare(pipeline: Pipeline) -> dict[str, Lack]:
    """Return what the channels lack for the bare airframe, by gate, at any time of a run.

    What a manoeuvre may be without must be missing in all. Where only the sticks moved the surfaces
    a yaw damper says nothing.
    """
    report, flown = pipeline.report(), pipeline.manoeuvres or []
    has = {
        "no_aileron": report.is_record or pipeline.channels.aileron is not None,
        "commands_on_grid": not report.is_record,
    }
    lacks = {name: (GATES[name].sentence, GATES[name].remedy) for name in has if not has[name]}
    if all(why := [not_driven(each) for each in flown] or ["no manoeuvre was found"]):
        lacks["not_driven"] = why[0], "fly rudder doublets, and then one of the aileron"
    held = [x.loop != AIRFRAME and pipeline.yaw_loop(x.from_s, x.to_s) for x in flown]
    if all(gains := held or [pipeline.yaw_loop(-math.inf, math.inf)]):
        lacks["yaw_damper"] = damped_by(str(gains[0]))
    rolls = [x.dutch_roll for x in flown if x.verdict.usable and x.dutch_roll is not None]
    slowest_hz = min((hz for each in report.channels.values() if (hz := each.rate_hz)), default=0.0)
    if rolls and all(slow := [too_slow(slowest_hz, roll) for roll in rolls]):
        ask_hz = next((each for each in NICE_HZ if each >= rolls[0].airframe_hz), None)
        whose = None if report.vehicle is None else report.vehicle.autopilot
        cure = ask_for(ask_hz, whose) if ask_hz else "no rate is enough for so fast a mode"
        lacks["too_slow"] = slow[0] or "", cure
    return lacks
