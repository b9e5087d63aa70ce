"""The test card: its numbers are the log's own, what is unknown is left blank."""

from __future__ import annotations

import json

import numpy as np
import pytest
from flightlog import FlightLog
from hand_flights import NOT_CONVERGED, forty, four_of_a_flight, none_usable
from manoeuvre.streams import stream
from msgspec.structs import replace
from places import C172P, REPLAY_LOGS
from printed import printed

from yawid.answers.flight_test_card import FlightTestCard
from yawid.answers.heard import VehicleSeen
from yawid.answers.inspection import Can, Inspection
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, ChannelFound, Origin, RunSummary
from yawid.cli.main import main
from yawid.results.make_card import Flown, make_card
from yawid.sinks.pages import to_text
from yawid.sinks.terminal.inspection import card_page

LIVE = "yawid live udpin:127.0.0.1:14560"
RUDDER = ChannelFound("servo4", min_us=1000.0, trim_us=1500.0, max_us=1900.0)


def card_of(
    summary: RunSummary,
    parameters: dict[str, float] | None = None,
    flown: Flown | None = None,
    bare: str = "",
) -> FlightTestCard:
    why = [each.text for each in summary.deciding.fatal]
    can = {"flown": Can(not why, why), "bare": Can(not bare, [bare] if bare else [])}
    return make_card(summary, can, flown or Flown(), {}, parameters or {}, 20.0, LIVE)


def page_of(summary: RunSummary, card: FlightTestCard | None) -> list[str]:
    origin = {name: getattr(summary, name) for name in Origin.__struct_fields__}
    report = Inspection(
        **origin, senders={}, by_sender={}, rates={}, excited=[], card=card,
        verdict=summary.verdict,
    )  # fmt: skip
    return to_text(card_page(report)).splitlines()


def test_times_are_parts_of_the_period_and_the_rudder_is_in_percent_pulses_and_degrees():
    card = card_of(replace(four_of_a_flight(), channels={"rudder": RUDDER})).manoeuvre
    first, most = card.amplitude

    assert card.period_s == pytest.approx(2 * np.pi / (10.21 * np.sqrt(1 - 0.624**2)))
    assert (card.side_s, card.unit_s) == (card.period_s / 2, card.period_s / 4)
    assert not card.wn_guessed
    assert (first.percent, first.low_us, first.high_us, first.deg) == (15.0, 1425.0, 1560.0, 3.0)
    assert (most.percent, most.low_us, most.high_us, most.deg) == (30.0, 1350.0, 1620.0, 6.0)


def test_more_manoeuvres_lower_the_noise_and_the_floor_but_not_what_all_have_in_common():
    after_4, after_8 = card_of(four_of_a_flight()).expected

    common = 0.16**2 - 0.03**2 - 0.15**2
    for expected, n in ((after_4, 6), (after_8, 10)):
        floor = 0.015 * 10.21 * np.sqrt(3 / (n - 1))
        wn_std = np.sqrt(common + 0.03**2 * 2 / n + floor**2)
        assert expected.wn_std == pytest.approx(wn_std)


def test_airspeeds_lie_within_what_was_flown_and_keep_away_from_the_stall():
    speeds = np.linspace(10.0, 30.0, 201)
    flown = Flown.of(stream(np.zeros(201), airspeed=speeds))

    assert card_of(four_of_a_flight(), flown=flown).conditions.airspeeds_m_s == [17.0, 20.0, 23.0]
    limited = card_of(four_of_a_flight(), {"AIRSPEED_MIN": 16.0}, flown)
    assert limited.conditions.airspeeds_m_s == [20.0, 23.0]
    assert card_of(four_of_a_flight()).conditions.airspeeds_m_s == []


def test_parameters_have_the_names_of_the_log_and_their_values_to_go_back_to():
    known = {"MAV1_EXTRA1": 4.0, "MAV2_EXTRA1": 10.0, "KFF_RDDRMIX": 0.5, "YAW2SRV_DAMP": 0.2}
    card = card_of(none_usable(), known)

    assert card.rates[0].name == "MAVn_EXTRA1"
    assert card.rates[0].now == {"MAV1_EXTRA1": 4.0, "MAV2_EXTRA1": 10.0}
    page = " ".join(" ".join(page_of(none_usable(), card)).split())
    said = ("MAVn_EXTRA1 = 25 for ATTITUDE; now 4 to 10", "YAW2SRV_DAMP = 0",
            "KFF_RDDRMIX = 0 (rudder follows the aileron); afterwards back to 0.5",
            "leave it on only to check its gain", "yawid diff BEFORE AFTER")  # fmt: skip
    assert [words for words in said if words not in page] == []


def test_without_an_answer_the_period_is_a_guess_and_says_so():
    card = card_of(none_usable())
    page = "\n".join(page_of(none_usable(), card))

    assert (card.manoeuvre.wn_rad_s, card.manoeuvre.wn_guessed) == (6.0, True)
    assert all(words in page for words in ("GUESSED", NOT_CONVERGED.text[:40], "[ ] ________"))

    of = four_of_a_flight()
    reason = Reason("manoeuvres_disagree", "manoeuvre 2 has wn 5 rad/s", weight="fatal")
    refused = replace(of.flight.verdict, usable=False, reasons=[reason])
    card = card_of(replace(of, flight=replace(of.flight, verdict=refused), verdict=refused))
    assert (card.answer, card.expected, card.answered) == (None, [], [])
    assert card.manoeuvre.wn_guessed
    assert card.lacks[0] == "manoeuvre 2 has wn 5 rad/s"


AILERON = ChannelFound("servo1", min_us=1100.0, trim_us=1500.0, max_us=1900.0)
FLOWN = Flown(airspeed_m_s=(20.0, 21.0, 22.0))


def test_where_every_manoeuvre_had_a_roll_loop_it_asks_for_an_aileron_doublet():
    """At 10.21 rad/s and .624 a swing lasts .788 s; 15 % of 400 us are 60; .15 * 45 is 7."""
    summary = replace(four_of_a_flight(), channels={"rudder": RUDDER, "aileron": AILERON})
    card = card_of(summary, flown=FLOWN)
    page = " ".join(" ".join(page_of(summary, card)).split())

    assert card.aileron.side_s == pytest.approx(0.788 / 4, rel=1e-3)
    assert card.aileron.expected.wn_std == pytest.approx(0.012 * 10.21)
    assert card.aileron.expected.zeta_std == pytest.approx(0.03 * 0.624)
    said = ("right 0.2 s, left 0.2 s, neutral; 15 % = 1440 / 1560 us",
            "Expect of the bare airframe wn ± 0.12, zeta ± 0.019",
            "or one with the aileron's doublet of part 3")  # fmt: skip
    assert [words for words in said if words not in page] == []

    slow = "attitude and servo outputs come at 10 Hz, and a mode of 10.2 rad/s needs 17 Hz"
    assert f"the bare airframe: {slow}" in card_of(summary, flown=FLOWN, bare=slow).lacks
    known = replace(summary, bare=Bare(used=[1], verdict=Verdict(usable=True, reasons=[])))
    assert not any("bare airframe" in each for each in card_of(known, flown=FLOWN).lacks)


def test_it_asks_for_none_where_the_airframe_would_stay_unknown_or_is_known_by_itself():
    """At 31 rad/s more than 0.6 of a radian passes between two messages at 50 Hz."""
    summary = four_of_a_flight()
    fast = replace(summary.flight.dutch_roll, wn_rad_s=31.0)
    bare = [replace(each, loop="airframe") for each in summary.manoeuvres]
    others = {
        "no airspeed": (summary, Flown()),
        "fast": (replace(summary, flight=replace(summary.flight, dutch_roll=fast)), FLOWN),
        "without a loop": (replace(summary, manoeuvres=bare), FLOWN),
        "no answer": (none_usable(), FLOWN),
    }

    assert card_of(summary, flown=FLOWN).aileron is not None
    assert [name for name, (of, flown) in others.items() if card_of(of, flown=flown).aileron] == []


@pytest.mark.parametrize("autopilot", [3, 12, 0, None])
@pytest.mark.parametrize("make", [none_usable, forty])
def test_it_is_one_page_of_80_columns_and_60_lines(make, autopilot: int | None):
    vehicle = None if autopilot is None else VehicleSeen(1, 1, 1, autopilot)
    summary = replace(make(), vehicle=vehicle)
    page = page_of(summary, card_of(summary, flown=FLOWN))

    assert len(page) <= 60
    assert max(map(len, page)) <= 80


def test_inspect_prints_the_card_of_a_log_and_puts_it_into_the_json(capsys):
    for log, code in ((C172P, 0), (REPLAY_LOGS / "no_rudder" / "log.tlog", 3)):
        assert main(["inspect", str(log), "--card"]) == code
        assert capsys.readouterr().out.startswith("TEST CARD")
    assert main(["inspect", str(C172P), "--card", "--json", "--rudder-max-deg", "16"]) == 0
    card = printed("inspect", capsys.readouterr().out)["card"]
    assert card["manoeuvre"]["wn_rad_s"] == pytest.approx(2.40, abs=0.02)
    assert card["manoeuvre"]["amplitude"][1]["deg"] == pytest.approx(4.8)
    assert card["live"] == f"{LIVE} --rudder-max-deg 16.0"


def test_what_has_no_rudder_gets_one_line_and_the_code_of_its_verdict(tmp_path, capsys):
    log = FlightLog()
    log.heartbeat(1.0, kind=2)
    for i in range(20):
        log.attitude(1.0 + 0.02 * i, 0.0)
    path = tmp_path / "copter.tlog"
    path.write_bytes(log.data)

    assert main(["inspect", str(path), "--card"]) == 3
    assert capsys.readouterr().out == (f"no card: a quadrotor has no rudder to move: {path}\n")
    assert main(["inspect", str(path), "--card", "--json"]) == 3
    assert "card" not in json.loads(capsys.readouterr().out)
