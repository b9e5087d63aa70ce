"""The recorded flights of the catalogue: an honest word on each.

The synthetic twins of their oddities are in tests/channels and tests/sources.
"""

from __future__ import annotations

from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any

import pytest
from flightlog import reasons_of
from inspecting import assert_is_read_in_ten_seconds
from places import SHARED_FLIGHTS as FLIGHTS
from printed import answered
from recorded_flights import OF_THE_PROJECT, recorded

SHARED = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")


def replay(capsys, tmp_path: Path, log: Path | str, *options: object) -> tuple[int, dict[str, Any]]:
    """Replay a log, or the whole recorded flight of a name, for what its rudder shows."""
    path = log if isinstance(log, Path) else FLIGHTS / f"{log}.tlog"
    return answered(capsys, "replay", path, "--out", tmp_path, "--ordinary", "off", *options)


def reasons(summary: dict[str, Any]) -> dict[str, str]:
    return {reason["id"]: reason["text"] for reason in reasons_of(summary)}


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
    # 144 were lost in a jump over 128, in the time that so many frames take.
    assert name != "copter_sik_radio" or 2856 + 144 <= summary["link"]["lost"] < 3200


@pytest.mark.parametrize(
    ("stretch", "reason", "text"),
    [
        ((), "mixed_rudder", "follows the aileron"),
        (("--from", 50, "--to", 110), "not_excited", "the rudder by itself moved less than 10 %"),
        pytest.param(
            ("--from", 50, "--to", 430),
            "not_excited",
            "the rudder by itself moved less than 10 %",
            marks=pytest.mark.long,
        ),
    ],
    ids=["whole", "cruise", "whole cruise"],
)
def test_turns_removed_do_not_make_a_mixed_rudder_usable(stretch, reason, text, capsys, tmp_path):
    """The rudder is half the aileron throughout; the stream's 7.9 and 11.6 are for 10.2 rad/s."""
    options = ("--turn", "remove", "--band", "0.15,3", *stretch)
    code, summary = replay(capsys, tmp_path, OF_THE_PROJECT["sitl_auto_25hz"], *options)

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
    log = FLIGHTS / f"{name}.tlog"
    yaw_hz, rudder_hz, seconds, *longest = AT_A_GLANCE[name]

    # Of these flights it alone answers as ordinary flight, which takes most of the time: the page
    # of such an answer is looked at in tests/runs/test_ordinary_runs.py.
    options = ("--ordinary", "off") if name == "sitl_auto_25hz" else ()
    code, report = answered(capsys, "inspect", log, *options)

    phases = [(p["to"] - p["from"], p["mode"], p.get("state")) for p in report["phases"]]
    length, *found = max(phases)
    assert report["rates"]["yaw"]["rate_hz"] == pytest.approx(yaw_hz, rel=0.03)
    if rudder_hz is not None:
        assert report["rates"]["rudder"]["rate_hz"] == pytest.approx(rudder_hz, rel=0.03)
    assert report["duration_s"] == pytest.approx(seconds, abs=1.0)
    assert [*found, length] == [*longest[:2], pytest.approx(longest[2], abs=1.5)]
    if name == "skywalker_manual_a":
        airborne = sum(each for each, _, state in phases if state == "airborne")
        assert airborne == pytest.approx(39.0, abs=1.0)
    if name == "sitl_fbwa_50hz":
        [excited] = report["excited"]
        assert [excited["from"], excited["to"]] == pytest.approx([86.5, 253.9], abs=5.0)
        assert (code, report["command"]) == (0, f"yawid replay {log}")
        assert report["senders"]["255/190"] == 13372
    if name == "sitl_fbwa_gcs_4hz":
        assert (code, "25 Hz" in report["record"][0]) == (4, True)
    assert_is_read_in_ten_seconds(report)


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
