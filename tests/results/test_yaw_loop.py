"""What an answer leaves out where the autopilot feeds the yaw rate back to the rudder."""

from __future__ import annotations

import msgspec
import pytest
from hand_flights import flight, manoeuvre
from hand_flights import summary as flight_summary

from yawid.answers.heard import BootSpan, GainSeen, gains_between
from yawid.answers.run_summary import (
    ChannelFound,
    RunSummary,
)
from yawid.results.yaw_loop import with_yaw_loop
from yawid.sinks.answers import cards, headline
from yawid.sinks.run_page import table_notes
from yawid.sinks.words import answer_rows

OF_A_SERVO = "without its yaw damper (YAW2SRV_DAMP 0.2): the servo output holds its part"


def flown(
    loop: str, yaw_loop: str | None, source: str = "SERVO_OUTPUT_RAW.servo4_raw"
) -> RunSummary:
    run = flight_summary([manoeuvre(1, loop=loop)], flight(used=[1], loop=loop))
    rudder = ChannelFound(source, yaw_loop=yaw_loop)
    return with_yaw_loop(msgspec.structs.replace(run, channels={"rudder": rudder}))


def test_every_place_says_that_the_answer_is_without_the_yaw_damper() -> None:
    run = flown("with_roll_loop", "YAW2SRV_DAMP 0.2")
    whole = f"the aircraft with its roll loop, {OF_A_SERVO}"

    assert whole in headline(run)
    assert cards(run)[0].notes[-1] == whole
    assert f"this is {whole}" in [row.text for row in answer_rows(run)]
    assert whole in table_notes(run.manoeuvres, [run.flight])
    assert run.manoeuvres[0].yaw_loop == run.flight.yaw_loop == OF_A_SERVO


def test_a_gain_that_changed_in_flight_is_that_of_each_manoeuvre() -> None:
    name, seen = "YAW2SRV_DAMP", []
    for value, boot, from_s in ((0.0, 1, 4.0), (0.5, 1, 150.0), (1.0, 1, 260.0), (0.2, 2, 7.0)):
        seen.append(GainSeen(name, value, boot, from_s))
    rudder = ChannelFound("SERVO_OUTPUT_RAW.servo4_raw", yaw_loop=f"{name} 0 to 1", yaw_gains=seen)
    spans = ((1, 100.0, 140.0), (2, 160.0, 200.0), (3, 250.0, 290.0))
    parts = [
        msgspec.structs.replace(manoeuvre(n, loop="with_roll_loop"), from_s=low, to_s=high)
        for n, low, high in spans
    ]
    run = flight_summary(parts, flight(used=[1, 2, 3], loop="with_roll_loop"))

    told = with_yaw_loop(msgspec.structs.replace(run, channels={"rudder": rudder}))

    said = [each.yaw_loop for each in (*told.manoeuvres, told.flight)]
    assert said[0] is None
    assert [each.split("(")[1].split(")")[0] for each in said[1:]] == [
        f"{name} 0.5", f"{name} 0.5 to 1", f"{name} 0 to 1",
    ]  # fmt: skip
    # The second boot lasted until its 170th second: those seconds are of both boots.
    boots = [BootSpan(1, 0.0, 300.0), BootSpan(2, 0.0, 170.0)]
    assert gains_between(seen, boots, 160.0, 200.0) == {name: [0.5, 0.2]}
    assert gains_between(seen, boots, 2.0, 5.0) == {name: [0.0, 1.0]}


@pytest.mark.parametrize(
    ("loop", "yaw_loop", "source", "said"),
    [
        ("airframe", "YAW2SRV_DAMP 0.2", "SERVO_OUTPUT_RAW.servo4_raw", None),
        ("with_roll_loop", None, "SERVO_OUTPUT_RAW.servo4_raw", None),
        ("unknown", "YAW2SRV_DAMP 0.2", "SERVO_OUTPUT_RAW.servo4_raw", OF_A_SERVO),
        (
            "with_roll_loop",
            "FW_YR_P 0.05",
            "ACTUATOR_CONTROL_TARGET.controls[2]",
            "without its yaw-rate loop (FW_YR_P 0.05): the servo output holds its part",
        ),
        (
            "with_roll_loop",
            "YAW2SRV_DAMP 0.2",
            "RC_CHANNELS.chan4_raw",
            "with its yaw damper (YAW2SRV_DAMP 0.2): the stick does not hold its part",
        ),
    ],
)
def test_it_depends_on_the_mode_the_gain_and_the_channel(
    loop: str, yaw_loop: str | None, source: str, said: str | None
) -> None:
    assert flown(loop, yaw_loop, source).flight.yaw_loop == said
