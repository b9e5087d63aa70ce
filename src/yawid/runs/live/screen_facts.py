"""The facts that line and screen show of a session, gathered from its pipeline."""

import time
from collections import deque
from typing import Final

from yawid.answers.reasons import ASK_HZ
from yawid.blocks import Held, words
from yawid.pipeline import Pipeline
from yawid.quantities.link import LinkStats
from yawid.results.judge_samples import message_rate_reasons
from yawid.runs.can import facts_of_bare
from yawid.runs.live.running_answer import Answer, said
from yawid.runs.live.standing import state
from yawid.sinks.terminal.console import SILENT, VehicleFacts

WINDOW_S = 2.0
"""Rates are counted over this time; where no sample is used for this long, the reason is shown."""
ASSUMED = ' (assumed: no parameters were heard; in MAVProxy type "param fetch")'

IN_FLIGHT: Final = {
    "rate_too_low": f"ask for attitude and servo outputs at {ASK_HZ} Hz (streamrate {ASK_HZ})",
    "not_in_command": "arm: the autopilot's outputs do not move the surfaces",
    "yaw_damper": "for the bare airframe: switch the yaw damper off",
    "too_slow": "for the bare airframe: attitude and servo outputs at 50 Hz",
    "aileron": "for the bare airframe: a doublet, then one of the aileron",
}
"""What a pilot, or the ground station, can do in the air: none of it is about a log."""


class Gatherer:
    """Gathers the facts of one session; it keeps the counts that rates are made from."""

    def __init__(self) -> None:
        self._counts = deque([(time.monotonic(), 0, 0, 0, 0)])

    def facts(
        self,
        pipeline: Pipeline,
        link: LinkStats,
        quiet: str,
        answer: Answer,
        label: str = "",
    ) -> VehicleFacts:
        """Return the facts.

        The verdict is the flight's: what the log lacks so far would advise a pilot in the air to
        use another log.
        """
        channels, vehicle = pipeline.channels, pipeline.channels.lock.vehicle
        rates, unused = self._rates(pipeline, link)
        progress, unanswered = pipeline.progress()
        verdict = answer.verdict if answer.flights else None
        status = state(pipeline)
        return VehicleFacts(
            sysid=0 if vehicle is None else vehicle.sysid,
            label=label,
            name="" if vehicle is None else f"{vehicle.sysid}/{vehicle.compid} {vehicle.kind}",
            rudder=", ".join(
                f"{each.source}{ASSUMED if each.how == 'assumed' else ''}"
                for each in channels.surfaces
            ),
            yaw=channels.yaw.label if channels.yaw.rows else "",
            quiet=quiet,
            held=_held(pipeline) if unused and not quiet else "",
            message_hz=rates[0],
            yaw_hz=rates[1],
            rudder_hz=rates[2],
            lost=link.lost,
            finds=pipeline.config.manoeuvres != "off",
            stroke=progress.stroke,
            rests_s=progress.rests_s,
            from_s=progress.from_s,
            lasted_s=progress.lasted_s,
            is_excited=progress.is_excited,
            unanswered=unanswered,
            manoeuvres=tuple(pipeline.manoeuvres or ()),
            flights=answer.flights,
            samples=pipeline.samples,
            answer=said(answer) if status else "",
            stream=status if answer.known or not status else f"{said(answer)}, {status}",
            state=SILENT if quiet else status,
            verdict=None if verdict is None else verdict.usable,
            why=() if verdict is None else tuple(map(str, verdict.fatal or verdict.reasons)),
            lacks=_lacks(pipeline, answer),
        )

    def _rates(self, pipeline: Pipeline, link: LinkStats) -> tuple[tuple[float, ...], bool]:
        """Return the rates of messages, yaw and rudder in Hz, and whether no sample is used."""
        yaw, rudder = pipeline.channels.flows
        now = time.monotonic(), link.frames, yaw.steps, rudder.steps, pipeline.channels.used
        self._counts.append(now)
        while len(self._counts) > 2 and now[0] - self._counts[1][0] >= WINDOW_S:
            self._counts.popleft()
        first = self._counts[0]
        lasted_s = now[0] - first[0]
        counted = zip(first[1:4], now[1:4], strict=True)
        rates = tuple((after - before) / max(lasted_s, 1e-9) for before, after in counted)
        return rates, lasted_s >= WINDOW_S and now[4] == first[4]


def _lacks(pipeline: Pipeline, answer: Answer) -> str:
    """Return what a pilot can do about what is missing, of the answer as flown before the airframe.

    It is "" where only a manoeuvre is missing, and while one is flown that shows both.
    """
    rates_hz, (under_way, unanswered) = pipeline.report().rates_hz, pipeline.progress()
    of_the_log = [] if answer.flights or answer.verdict is None else answer.verdict.fatal
    rates = [] if rates_hz is None else message_rate_reasons(*rates_hz)
    lacks = [each.id for each in (*of_the_log, *rates) if each.exit_code]
    is_busy = unanswered or under_way.from_s is not None
    if answer.known and not is_busy and not any(x.lateral for x in pipeline.manoeuvres or ()):
        lacks += [*facts_of_bare(pipeline), "aileron"]
    return next((IN_FLIGHT[each] for each in lacks if each in IN_FLIGHT), "")


def _held(pipeline: Pipeline) -> str:
    """Return in words why the newest sample is not used, "" where there is none."""
    if pipeline.newest is None:
        return ""
    return ", ".join(words(flag) for flag in Held(int(pipeline.newest.held[-1])))
