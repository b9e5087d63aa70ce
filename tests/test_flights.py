"""The recorded flights of the catalogue: an honest word on each.

The synthetic twins of their oddities are in tests/channels and tests/sources.
"""

from __future__ import annotations

import json
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import pytest
from flightlog import reasons_of
from inspecting import assert_is_read_in_ten_seconds
from places import SHARED_FLIGHTS as FLIGHTS
from printed import printed
from recorded_flights import OF_THE_PROJECT, recorded

from yawid.cli.main import main

SHARED = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")


def replay(capsys, tmp_path: Path, log: Path | str, *options: object) -> tuple[int, dict[str, Any]]:
    """Replay a log, or the whole recorded flight of a name."""
    path = log if isinstance(log, Path) else FLIGHTS / f"{log}.tlog"
    arguments = ["replay", path, "--out", tmp_path, "--json", *options]
    code = main([str(argument) for argument in arguments])
    return code, printed("replay", capsys.readouterr().out)


def reasons(summary: dict[str, Any]) -> dict[str, str]:
    return {reason["id"]: reason["text"] for reason in reasons_of(summary)}


AS_FLOWN = {"wn": 10.22, "zeta": 0.630}
"""The simulator's plane at 22 m/s, linearised and closed with FBWA's roll loop."""
EXCITED = ("--rate", 25, "--memory", "inf", "--from", 86.5, "--to", 253.9)


@recorded("sitl_fbwa_50hz")
def test_sitl_fbwa_has_its_dutch_roll(log, capsys, tmp_path):
    code, summary = replay(capsys, tmp_path, log, *EXCITED, "--method", "rml")

    found = summary["estimates"]["rml"]["dutch_roll"]
    assert code == 0
    assert found["wn_rad_s"] == pytest.approx(AS_FLOWN["wn"], rel=0.01)
    assert found["zeta"] == pytest.approx(AS_FLOWN["zeta"], abs=0.02)
    # Sigma covers the aircraft as flown: with the roll that the rudder makes, and its roll loop.
    assert abs(found["wn_rad_s"] - AS_FLOWN["wn"]) < 3.0 * found["wn_std"]
    assert abs(found["zeta"] - AS_FLOWN["zeta"]) < 3.0 * found["zeta_std"]
    assert "rudder_assumed" in reasons(summary)
    servo = summary["estimates"]["rml"]["physics"]["servo_tau_s"]
    assert servo["value"] == pytest.approx(0.14, abs=0.03)


@recorded("sitl_fbwa_50hz", "sitl_fbwa_stock_33hz", trimmed=False)
def test_a_steep_turn_at_the_end_draws_the_stream_away_and_not_the_answer(log, capsys, tmp_path):
    """Both methods of the stream are drawn away from 10.22 rad/s in the turn's five seconds."""
    code, summary = replay(capsys, tmp_path, log)

    found = summary["flight"]["dutch_roll"]
    assert code == 0
    assert abs(found["wn_rad_s"] - AS_FLOWN["wn"]) < 3.0 * found["wn_std"]
    assert abs(found["zeta"] - AS_FLOWN["zeta"]) < 3.0 * found["zeta_std"]
    assert found["wn_std"] < 0.05 * AS_FLOWN["wn"]


@recorded("sitl_fbwa_stock_33hz")
def test_sitl_fbwa_at_stock_rates_has_nearly_the_same(log, capsys, tmp_path):
    code, summary = replay(capsys, tmp_path, log, *EXCITED, "--method", "rml")

    found = summary["estimates"]["rml"]["dutch_roll"]
    assert code == 0
    assert found["wn_rad_s"] == pytest.approx(AS_FLOWN["wn"], rel=0.02)
    assert found["zeta"] == pytest.approx(AS_FLOWN["zeta"], abs=0.04)


RUDDER = ("channels", "rudder")
REFUSED: dict[str, tuple[int, dict[str, str], dict[tuple[str, ...], object]]] = {
    "sitl_fbwa_gcs_4hz": (4, {"rate_too_low": "2 Hz"}, {}),
    "sitl_auto_25hz": (5, {"mixed_rudder": "% by itself"}, {}),
    "sitl_auto_mavproxy_4hz": (4, {}, {(*RUDDER, "how"): "parameter"}),
    "skywalker_manual_a": (
        5, {"not_converged": "not known well enough", "disarmed": "every HEARTBEAT"},
        {(*RUDDER, "source"): "ACTUATOR_CONTROL_TARGET.controls[2]"},
    ),
    "vtol_quadplane": (3, {"no_rudder": "SERVO3=75, SERVO4=76"}, {("link", "clock_steps"): 1}),
    "copter_sik_radio": (3, {"no_rudder": "quadrotor (type 2)"}, {("link", "reboots"): 4}),
}  # fmt: skip
"""By flight: exit code, reasons with a part of their texts, and numbers of the summary."""


@recorded(*REFUSED)
def test_a_flight_that_cannot_answer_is_refused_with_its_reasons(log: Path, capsys, tmp_path):
    code, summary = replay(capsys, tmp_path, log)

    name = next(n for n in REFUSED if log in (FLIGHTS / f"{n}.tlog", OF_THE_PROJECT.get(n)))
    expected, texts, facts = REFUSED[name]
    assert code == expected
    for reason, text in texts.items():
        assert text in reasons(summary)[reason]
    for path, value in facts.items():
        assert reduce(getitem, path, summary) == value
    assert code != 3 or "estimates" not in summary
    assert name != "copter_sik_radio" or summary["link"]["lost"] >= 2856


@recorded("sitl_auto_25hz")
@pytest.mark.parametrize(
    ("stretch", "reason", "text"),
    [
        ((), "mixed_rudder", "follows the aileron"),
        (("--from", 50, "--to", 430), "not_excited", "the rudder by itself moved less than 10 %"),
    ],
    ids=["whole", "cruise"],
)
def test_turns_removed_do_not_make_a_mixed_rudder_usable(
    stretch, reason, text, log, capsys, tmp_path
):
    """The rudder is half the aileron throughout; the stream's 7.9 and 11.6 are for 10.2 rad/s."""
    options = ("--turn", "remove", "--band", "0.15,3", *stretch)
    code, summary = replay(capsys, tmp_path, log, *options)

    assert code == 5
    assert text in reasons(summary)[reason]


@SHARED
def test_alfas_rudder_and_aileron_cannot_be_separated(capsys, tmp_path):
    options = ("--rudder", "servo:4", "--aileron", "servo:5", "--inputs", "rudder,aileron")
    code, summary = replay(capsys, tmp_path, "alfa_carbonz_engine_failure", *options)

    # Less than three messages a second on the vehicle's own clock come first in the contract's
    # order; its twin at 20 Hz is in tests/runs/test_inspect_log.py.
    assert code == 4
    assert list(reasons(summary))[:2] == ["rate_too_low", "mixed_rudder"]
    assert "follows the aileron" in reasons(summary)["mixed_rudder"]


STOCK = {"min_us": 1100, "trim_us": 1500, "max_us": 1900, "reversed": False, "how": "assumed"}


@recorded("sitl_fbwa_50hz", "sitl_fbwa_stock_33hz", "sitl_fbwa_gcs_4hz", "sitl_auto_25hz")
def test_without_functions_the_stock_channels_are_assumed(log: Path, capsys, tmp_path):
    options = ("--inputs", "rudder,aileron", "--manoeuvres", "off")
    _, summary = replay(capsys, tmp_path, log, *options)

    for surface, servo in (("rudder", 4), ("aileron", 1)):
        found = summary["channels"][surface]
        assert found["source"] == f"SERVO_OUTPUT_RAW.servo{servo}_raw"
        assert STOCK.items() <= found.items()
    assert "rudder_assumed" in reasons(summary)


# On the vehicle's clock: yaw Hz, rudder Hz, seconds; the longest phase and its seconds.
AT_A_GLANCE = {
    "alfa_carbonz_engine_failure": (2.5, 2.9, 132, "GUIDED", "airborne", 132),
    "copter_sik_radio": (2.9, None, 2444, "STABILIZE", "slow", 515),
    "sitl_auto_25hz": (25.0, 25.0, 495, "AUTO", "airborne", 437.5),
    "sitl_auto_mavproxy_4hz": (3.9, 3.8, 495, "AUTO", "airborne", 437.5),
    "sitl_fbwa_50hz": (50.0, 50.0, 270, "FBWA", "airborne", 213),
    "sitl_fbwa_gcs_4hz": (4.0, 2.0, 270, "FBWA", "airborne", 213),
    "sitl_fbwa_stock_33hz": (25.6, 25.0, 270, "FBWA", "airborne", 213),
    "skywalker_manual_a": (10.2, 10.0, 89, "MANUAL", "on ground", 50),
    "vtol_quadplane": (4.2, None, 208, "QLAND", "slow", 71),
}


@SHARED
@pytest.mark.parametrize("name", AT_A_GLANCE)
def test_a_flight_is_known_at_a_glance(name: str, capsys):
    log = str(FLIGHTS / f"{name}.tlog")
    yaw_hz, rudder_hz, seconds, *longest = AT_A_GLANCE[name]

    main(["inspect", log, "--json"])
    report = json.loads(capsys.readouterr().out)

    found = max(report["phases"], key=lambda phase: phase["to"] - phase["from"])
    assert report["rates"]["yaw"]["rate_hz"] == pytest.approx(yaw_hz, rel=0.03)
    if rudder_hz is not None:
        assert report["rates"]["rudder"]["rate_hz"] == pytest.approx(rudder_hz, rel=0.03)
    assert report["duration_s"] == pytest.approx(seconds, abs=1.0)
    assert [found["mode"], found["state"]] == longest[:2]
    assert found["to"] - found["from"] == pytest.approx(longest[2], abs=1.5)
    assert_is_read_in_ten_seconds(report)


@SHARED
def test_skywalker_flies_for_39_seconds(capsys):
    main(["inspect", str(FLIGHTS / "skywalker_manual_a.tlog"), "--json"])
    report = json.loads(capsys.readouterr().out)

    seconds = [p["to"] - p["from"] for p in report["phases"] if p["state"] == "airborne"]
    assert sum(seconds) == pytest.approx(39.0, abs=1.0)


@SHARED
def test_skywalker_with_its_turns_removed_has_an_estimate_that_nobody_would_act_on(
    capsys, tmp_path
):
    options = ("--turn", "remove", "--band", "0.15,3")
    code, summary = replay(capsys, tmp_path, "skywalker_manual_a", *options)

    estimate = summary["estimates"]["els"]
    assert code == 5
    assert 5.0 < estimate["dutch_roll"]["wn_rad_s"] < 7.0
    assert estimate["dutch_roll"]["wn_std"] > 0.1 * estimate["dutch_roll"]["wn_rad_s"]
    assert 5.0 < estimate["fit"]["simulation_pct"] < 20.0
    assert {"airspeed_changed", "disarmed", "not_converged"} <= reasons(summary).keys()


@SHARED
def test_inspect_finds_where_the_flight_was_excited_and_what_to_ask(capsys):
    log = str(FLIGHTS / "sitl_fbwa_50hz.tlog")
    code = main(["inspect", log, "--json"])
    report = json.loads(capsys.readouterr().out)

    assert code == 0
    [excited] = report["excited"]
    assert excited["from"] == pytest.approx(86.5, abs=5.0)
    assert excited["to"] == pytest.approx(253.9, abs=5.0)
    assert report["command"] == f"yawid replay {log}"
    assert report["senders"]["255/190"] == 13372


@SHARED
def test_inspect_says_what_to_record_where_a_log_cannot_answer(capsys):
    code = main(["inspect", str(FLIGHTS / "sitl_fbwa_gcs_4hz.tlog"), "--json"])
    report = json.loads(capsys.readouterr().out)

    assert code == 4
    assert "25 Hz" in report["record"][0]
