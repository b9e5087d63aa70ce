"""What ``yawid inspect`` says of a log: how it was flown and recorded, and what to do next time."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flightlog import FlightLog, fly, summarised
from flights.surgery import edited, join, split
from gate import one_in
from hypothesis import given
from hypothesis import strategies as st
from inspecting import assert_is_read_in_ten_seconds, inspected, page_of
from places import C172P, ROOT
from places import SHARED_FLIGHTS as FLIGHTS
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from sources.mavlink.test_signing import KEY, PASSPHRASE

from yawid.channels.series import Series
from yawid.channels.survey import Survey
from yawid.channels.yaw_reader import MODE, ON_GROUND, ROW
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.quantities.vehicles import mode_name
from yawid.runs.inspect_log import inspect

RECORDED = sorted(
    [*FLIGHTS.glob("*.tlog"), *FLIGHTS.glob("*.ulg"), *ROOT.glob("replay_logs/*/log.tlog")]
)
ARMED = 128
NONE: dict[str, Any] = {"verdict": {"usable": False}}
"""What an answer is that a summary does not have."""


def mode_flight(
    *stretches: tuple[float, float, int, float], kind: int = 1, autopilot: int = 3
) -> FlightLog:
    """Log ATTITUDE and servos at 10 Hz; stretches are (from s, to s, custom mode, speed m/s)."""
    log = FlightLog()
    for begin, end, mode, speed in stretches:
        armed = ARMED if speed > 0.0 else 0
        for t in np.arange(begin, end, 0.1).tolist():
            if round(10 * t) % 10 == 0 or t == begin:
                log.add(t, mavlink.MAVLink_heartbeat_message(kind, autopilot, armed, mode, 4, 3))
                log.add(t, mavlink.MAVLink_vfr_hud_message(speed, speed, 0, 50, 100.0 + speed, 0.0))
            log.attitude(t, 0.1 * np.sin(t))
            log.servos(t + 0.03, [1500, 1500, 1500, round(1500 + 100 * np.sin(3 * t))])
    return log


@pytest.mark.parametrize(
    ("log", "phases", "words"),
    [
        (
            lambda: mode_flight(
                (10, 20, 0, 0.0), (20, 30, 13, 18.0), (30, 45, 5, 20.0), (45, 50, 99, 0.0)
            ),
            [
                "1 10 20 MANUAL on ground", "1 20 30 TAKEOFF airborne", "1 30 45 FBWA airborne",
                "1 45 50 mode 99 on ground",
            ],
            "phases 10 to 20 s MANUAL on ground, 20 to 30 s TAKEOFF airborne",
        ),
        (
            lambda: mode_flight(
                (10, 20, 1 << 16, 20.0), (20, 30, 4 << 16 | 4 << 24, 20.0), autopilot=12
            ),
            ["1 10 20 MANUAL airborne", "1 20 30 MISSION airborne"], "",
        ),
        # Not said to stand on the ground.
        (lambda: mode_flight((10, 20, 5, 1.0), kind=2), ["1 10 20 LOITER slow"], ""),
        # Without speeds it is unknown whether it flew.
        (lambda: fly(lambda t: 0.1, lambda t: 1500, 10.0), ["1 10 20 MANUAL None"], ""),
        # A reboot starts a boot of its own, and a step of the clock does not.
        (
            lambda: mode_flight((10, 20, 5, 20.0), (18, 30, 5, 20.0), (12, 25, 5, 20.0)),
            ["1 10 30 FBWA airborne", "2 12 25 FBWA airborne"], "boot 2: 12 to 25 s FBWA",
        ),
    ],
)  # fmt: skip
def test_a_flight_is_told_mode_by_mode_on_the_ground_and_in_the_air(
    log: Callable[[], FlightLog], phases: list[str], words: str, tmp_path: Path, capsys
) -> None:
    _, report = inspected(log().data, tmp_path, capsys)
    told = [
        f"{p['boot']} {round(p['from'])} {round(p['to'])} {p['mode']} {p.get('state')}"
        for p in report["phases"]
    ]
    assert told == phases
    assert words in " ".join(page_of(report).split())


def test_the_names_of_modes_are_the_vehicles_own():
    names = {
        (3, 1, 5): "FBWA", (3, 2, 5): "LOITER", (3, 1, 4_000_000_000): "mode 4000000000",
        (12, 1, 99 << 16): f"mode {99 << 16}", (0, 1, 5): "mode 5", (3, 250, 5): "mode 5",
    }  # fmt: skip
    assert {of: mode_name(*of) for of in names} == names


STEPS = st.tuples(
    st.sampled_from([20_000, 20_000, 0, -40_000, -1_400_000, -90_000_000, 447_000_000]),
    st.integers(0, 1),
    st.integers(0, 2),
)


@given(st.lists(STEPS, min_size=1, max_size=40), st.lists(st.integers(0, 40), max_size=6))
def test_phases_and_intervals_do_not_depend_on_the_cut(
    steps: list[tuple[int, int, int]], cuts: Sequence[int]
):
    values = np.zeros((len(steps), len(ROW)))
    values[:, ROW.index("airspeed")] = 20.0
    values[:, [ON_GROUND, MODE]] = [told for _, *told in steps]
    order, t_us = np.arange(len(steps)), np.cumsum([step for step, *_ in steps])
    series, none = Series(order, order, t_us.astype(np.int64), values), Series.empty(1)
    whole, pieces = Survey(), Survey()
    whole.note(series, none)
    for low, high in pairwise([0, *sorted(cuts), len(steps)]):
        pieces.note(series.select(slice(low, high)), none)

    assert pieces.phases(3, 1) == whole.phases(3, 1)
    assert pieces.rates() == whole.rates()
    assert all(phase.from_s <= phase.to_s for phase in whole.phases(3, 1))


def test_jitter_is_the_middle_of_the_intervals_and_a_gap_or_a_reboot_is_none(
    tmp_path: Path, capsys
):
    log, rng, t = FlightLog(), np.random.default_rng(2), 10.0
    log.heartbeat(10.0)
    for i in range(2000):
        t = round(t + rng.uniform(0.03, 0.05) + {500: 7.0, 1000: -30.0}.get(i, 0.0), 3)
        log.attitude(t, 0.1 * np.sin(t))
        if i % 2 == 0:
            log.servos(t, [1500, 1500, 1500, 1500])

    _, report = inspected(log.data, tmp_path, capsys)

    assert report["link"]["frames"] == sum(report["senders"].values()) == 3001
    yaw, rudder = report["rates"]["yaw"], report["rates"]["rudder"]
    assert yaw["messages"] == 2 * rudder["messages"] == 2000
    for middle, found in ((0.040, "median"), (0.031, "p5"), (0.049, "p95")):
        assert yaw[f"interval_{found}_s"] == pytest.approx(middle, abs=0.001)
    fastest = report["answerable"]["wn_max_rad_s"]
    found = [yaw["rate_hz"], rudder["rate_hz"], fastest]
    assert found == pytest.approx([25.0, 12.5, 2 * np.pi * 12.5 / 4], rel=0.03)
    said = " ".join(page_of(report).split())
    assert "interval yaw 40 ms (5-95 %: 31 to 49), rudder 80 ms" in said


@pytest.mark.parametrize(
    "path", one_in(9, RECORDED), ids=lambda path: f"{path.parent.name}/{path.name}"
)
def test_a_page_is_read_in_ten_seconds_and_its_command_has_the_verdict_that_inspect_gave(
    path, capsys, tmp_path
):
    code, report = inspected(path, tmp_path, capsys)
    assert_is_read_in_ten_seconds(report)

    again = main(["replay", str(path), "--json", "--out", str(tmp_path)])
    summary = json.loads(capsys.readouterr().out)
    assert again == code
    for key in ("verdict", "manoeuvres", "flight"):
        assert summary.get(key) == report.get(key), key
    assert [name for name, can in report["can"].items() if can["yes"] == bool(can["lacks"])] == []
    assert report["can"]["flown"]["yes"] == (code == 0)
    assert report["can"]["ordinary"]["yes"] == summary.get("ordinary", NONE)["verdict"]["usable"]
    if not report["can"]["damper"]["yes"]:
        main(["damper", str(tmp_path / f"{path.stem}.mcap"), "--json"])
        assert json.loads(capsys.readouterr().out)["gains"] == []
    if "command" in report:
        assert shlex.split(report["command"]) == ["yawid", "replay", str(path)]
    else:
        assert (code != 0, report["verdict"]["usable"]) == (True, False)


RATES = "SRn_EXTRA1 = 10 and SRn_RC_CHAN = 10"


@pytest.mark.parametrize(
    ("log", "flown", "bare", "ordinary", "damper"),
    [
        ("c172p_gcs_rates", "",
         "attitude and servo outputs come at 5 Hz, and a mode of 2.45 rad/s needs 10 ", "290 s of",
         "SCHED_LOOP_RATE is not in the log: delay and washout depend on it; nor are YAW2SRV_DAMP"),
        ("c172p_damped", "", "the yaw damper (YAW2SRV_DAMP 0.22) moves the rudder", "290 s of", ""),
        ("c172p_damper", "", "", "290 s of", ""),
        ("turns_calm", "the rudder follows the aileron", "no manoeuvre was found; fly rudder",
         "", "there is no usable answer as flown"),
        ("no_rudder", "none of the servo functions is a rudder", "no manoeuvre was found",
         "there is no sample", "there is no usable answer as flown"),
    ],
)  # fmt: skip
def test_a_log_says_of_each_answer_whether_it_can_give_it_and_what_cures_it(
    log: str, flown: str, bare: str, ordinary: str, damper: str, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    """All before any fit of the airframe: with it, what is refused here is refused, too."""
    path = ROOT / "replay_logs" / log / "log.tlog"
    _, report = inspected(path, tmp_path, capsys, "--lateral", "off")

    starts = {"flown": flown, "bare": bare, "ordinary": ordinary, "damper": damper}
    first = {name: [*can["lacks"], ""][0] for name, can in report["can"].items()}
    assert {name: first[name][: len(said)] for name, said in starts.items()} == starts
    assert {name: can["yes"] for name, can in report["can"].items()} == {
        name: not said for name, said in starts.items()
    }
    page = " ".join(page_of(report).split())
    for name, said in (first | {"flown": flown and "see the verdict"}).items():
        assert f" {name} {f'no: {said}' if said else 'yes'}" in page
    if log == "c172p_damped":
        _, early = inspected(path, tmp_path, capsys, "--lateral", "off", "--to", "32")
        found = early["can"]["bare"]["lacks"]
        assert [each[:12] for each in found] == ["no manoeuvre", "the yaw damp"]
    if flown == "" != bare:
        assert (RATES in first["bare"]) == first["bare"].startswith("attitude")
        _, known = inspected(path, tmp_path, capsys, "--lateral", "auto")
        assert known["can"] == report["can"]


def test_inspect_says_the_options_asked_for_and_the_card_has_the_answer_of_that_replay():
    part = {"from_s": 40.0, "to_s": 80.0}
    report = inspect(C172P, part, with_card=True)
    again = summarised(C172P, RunConfig(**part))

    assert report.command == f"yawid replay {C172P} --from 40.0 --to 80.0"
    assert report.verdict == again.verdict
    assert report.card.answer == again.flight.dutch_roll


def test_with_a_key_only_the_signed_vehicle_is_inspected(tmp_path: Path, capsys):
    key, log = tmp_path / "key", FlightLog()
    key.write_text(PASSPHRASE, encoding="utf-8")
    for t in np.arange(10.0, 20.0, 0.05).tolist():
        log.heartbeat(t)
        log.attitude(t, 0.1)
        log.servos(t, [1500] * 8)
    plain = split(bytes(log.data))
    both = [each for pair in zip(edited(plain, key=KEY), plain, strict=True) for each in pair]

    _, report = inspected(join(both), tmp_path, capsys, "--signing-key-file", str(key))

    assert report["link"]["unsigned_rejected"] == len(plain)
    assert report["rates"]["yaw"]["messages"] == 200
    assert PASSPHRASE not in json.dumps(report)


def flown(
    kind: int = 1, autopilot: int = 3, step_s: float = 0.05, servos: str = "",
    yaws: bool = True, **parameters: float,
) -> FlightLog:  # fmt: skip
    """A flight of 30 s; its servos are at ``rest``, ``mixed`` with the aileron, or not there."""
    log = FlightLog()
    log.heartbeat(10.0, kind=kind, autopilot=autopilot)
    for name, value in parameters.items():
        log.parameter(10.0, name, value)
    for t in np.arange(10.0, 40.0, step_s).tolist():
        stick = round(200 * np.sin(1.3 * t) * np.cos(0.4 * t)) if servos == "mixed" else 0
        if yaws:
            log.attitude(t, 0.3 * np.sin(1.3 * t - 0.5))
        if servos:
            log.servos(t, [1500 + stick, 1500, 1500, 1500 + stick // 2])
    return log


RUDDER = ("--rudder", "servo:4")
SLOW = {"step_s": 0.3, "servos": "rest"}


@pytest.mark.parametrize(
    ("log", "options", "words"),
    [
        # A slow log is told the rates to ask its autopilot for.
        (partial(flown, **SLOW), RUDDER, ["SRn_EXTRA1 = 25"]),
        (partial(flown, autopilot=12, **SLOW), RUDDER, ["mavlink stream"]),
        (partial(flown, autopilot=0, **SLOW), RUDDER, ["MAV_CMD_SET_MESSAGE_INTERVAL"]),
        # What a log without a rudder is told depends on why.
        (partial(flown, kind=2), (), ["has no rudder: record an aircraft that has one"]),
        (partial(flown, SERVO4_FUNCTION=4.0), (), ["SERVOn_FUNCTION = 21"]),
        (flown, (), ["ask for SERVO_OUTPUT_RAW"]),
        (partial(flown, kind=0), (), ["download the parameters"]),
        # A rudder that only follows the aileron is told how to part them.
        (
            partial(flown, servos="mixed"), ("--inputs", "rudder,aileron"),
            ["KFF_RDDRMIX = 0", "3-2-1-1", "download the parameters"],
        ),
        (partial(flown, kind=6, autopilot=8, yaws=False), (), ["HEARTBEAT"]),
        (partial(flown, servos="rest", yaws=False), (), ["ATTITUDE (30)"]),
    ],
)  # fmt: skip
def test_the_advice_names_what_was_missing_and_where_to_ask_for_it(
    log: Callable[[], FlightLog], options: tuple[str, ...], words: list[str], tmp_path: Path, capsys
) -> None:
    code, report = inspected(log().data, tmp_path, capsys, *options)
    told = " | ".join(report["record"])
    assert [each for each in words if each not in told] == []
    if "KFF_RDDRMIX = 0" in words:
        assert (code, report["verdict"]["reasons"][0]["id"]) == (5, "mixed_rudder")
