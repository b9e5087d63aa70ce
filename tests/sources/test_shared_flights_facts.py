"""The catalogue's figures, read from the recorded flights.

The synthetic twin of each is in tests/test_faults.py, tests/test_faults_channels.py and
tests/channels.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flights.surgery import split
from places import SHARED_FLIGHTS as FLIGHTS
from recorded_flights import recorded
from sources.tlog_records import run

SHARED = pytest.mark.skipif(not FLIGHTS.is_dir(), reason="the recorded flights are not here")

WANTED = frozenset(
    {"ATTITUDE", "SERVO_OUTPUT_RAW", "PARAM_VALUE", "VFR_HUD", "ACTUATOR_CONTROL_TARGET"}
)


@cache
def fields(flight: str | Path) -> dict[str, Any]:
    """Return the fields of every wanted message, and the receive stamps under ``received_us``."""
    log = flight if isinstance(flight, Path) else FLIGHTS / f"{flight}.tlog"
    blocks, _ = run(log.read_bytes(), wanted=WANTED)
    found: dict[str, Any] = {}
    for name in WANTED:
        parts = [block.messages[name] for block in blocks if name in block.messages]
        if parts:
            found[name] = np.concatenate([part.fields for part in parts])
            found[name, "received_us"] = np.concatenate([part.received_us for part in parts])
    return found


def boot_s(flight: str | Path) -> Any:
    return fields(flight)["ATTITUDE"]["time_boot_ms"].astype(float) / 1e3


@cache
def records(flight: str) -> tuple[Any, Any]:
    """Return stamp and first byte of every record of a log without garbage."""
    found = split((FLIGHTS / f"{flight}.tlog").read_bytes())
    stamps, magics = zip(*((stamp, frame[0]) for stamp, frame in found), strict=True)
    return np.array(stamps), np.array(magics)


def functions(flight: str | Path) -> list[str]:
    """Return the names of the servo functions among a flight's parameters."""
    told = fields(flight).get("PARAM_VALUE")
    names = [] if told is None else np.unique(told["param_id"]).tolist()
    return [n for n in (b.decode() for b in names) if n.startswith("SERVO") and "FUNCTION" in n]


@recorded(
    "sitl_fbwa_50hz",
    "sitl_fbwa_stock_33hz",
    "sitl_fbwa_gcs_4hz",
    "sitl_auto_25hz",
    "alfa_carbonz_engine_failure",
    "copter_sik_radio",
)
def test_these_logs_name_no_servo_function(log: Path) -> None:
    assert functions(log) == []


@recorded("sitl_auto_mavproxy_4hz", "vtol_quadplane")
def test_these_logs_name_their_servo_functions(log: Path) -> None:
    assert len(functions(log)) >= 4


@recorded("sitl_fbwa_stock_33hz")
def test_stock_intervals_mix_20_and_40_ms(log: Path) -> None:
    steps = np.diff(boot_s(log))
    assert np.percentile(steps, [5, 95]) == pytest.approx([0.02, 0.04], abs=0.002)
    assert np.mean(np.abs(steps - 0.03) > 0.005) > 0.95


@recorded("sitl_auto_25hz", "sitl_auto_mavproxy_4hz", trimmed=False)
def test_the_mission_wraps_its_yaw_eight_times(log: Path) -> None:
    assert (np.abs(np.diff(fields(log)["ATTITUDE"]["yaw"])) > np.pi).sum() == 8


@recorded("sitl_auto_25hz")
def test_the_missions_rudder_is_half_its_aileron(log: Path) -> None:
    servos = fields(log)["SERVO_OUTPUT_RAW"]
    t = servos["time_usec"] / 1e6
    aileron, rudder = (servos[f"servo{n}_raw"][(t > 30.0) & (t < 460.0)] * 1.0 for n in (1, 4))
    assert np.corrcoef(aileron, rudder)[0, 1] > 0.999
    assert np.polyfit(aileron, rudder, 1)[0] == pytest.approx(0.5, abs=0.01)


@recorded("sitl_auto_mavproxy_4hz")
def test_mavproxys_record_has_gaps_of_1_9_s(log: Path) -> None:
    assert np.diff(boot_s(log)).max() == pytest.approx(1.9, abs=0.05)


@SHARED
def test_alfas_rudder_is_half_its_aileron_in_a_log_of_both_versions() -> None:
    servos = fields("alfa_carbonz_engine_failure")["SERVO_OUTPUT_RAW"]
    rudder, aileron = (servos[f"servo{n}_raw"].astype(float) for n in (4, 5))
    stamps, magics = records("alfa_carbonz_engine_failure")
    assert np.polyfit(aileron, rudder, 1)[0] == pytest.approx(0.4975, abs=1e-4)
    assert np.corrcoef(rudder, aileron)[0, 1] == pytest.approx(0.9999, abs=1e-4)
    assert (stamps[-1] - stamps[0]) / 1e6 == pytest.approx(132.0, abs=1.0)
    assert set(magics.tolist()) == {0xFE, 0xFD}


@SHARED
def test_alfas_own_clock_has_less_than_three_messages_a_second_and_none_were_lost() -> None:
    """Why its verdict begins with ``rate_too_low``: it is the log, not loss or receive stamps."""
    found = fields("alfa_carbonz_engine_failure")
    servo_s = found["SERVO_OUTPUT_RAW"]["time_usec"].astype(float) / 1e6
    for t in (boot_s("alfa_carbonz_engine_failure"), servo_s):
        assert 2.4 < 1.0 / np.median(np.diff(t)) < 3.0
    _, decoder = run((FLIGHTS / "alfa_carbonz_engine_failure.tlog").read_bytes())
    assert decoder.link.lost == 0


@SHARED
def test_skywalkers_rudder_is_its_own_and_the_yaw_rate_answers_after_a_tenth_of_a_second() -> None:
    found = fields("skywalker_manual_a")
    controls, attitude, hud = (found[n] for n in ("ACTUATOR_CONTROL_TARGET", "ATTITUDE", "VFR_HUD"))
    t = controls["time_usec"].astype(float) / 1e6
    received = (found[name, "received_us"] for name in ("ACTUATOR_CONTROL_TARGET", "VFR_HUD"))
    flying = np.interp(*received, hud["airspeed"]) > 8.0
    rudder, aileron = controls["controls"][:, 2], controls["controls"][:, 0]
    lags = np.arange(0.0, 0.6, 0.1)
    answers = [
        np.corrcoef(
            rudder[flying],
            np.interp(t + lag, boot_s("skywalker_manual_a"), attitude["yawspeed"])[flying],
        )[0, 1]
        for lag in lags
    ]
    assert np.sum(flying) / 10.0 == pytest.approx(39.0, abs=2.0)
    # How far apart depends on the stretch taken; the peak over the lag is broad.
    assert abs(np.corrcoef(rudder[flying], aileron[flying])[0, 1]) < 0.1
    assert lags[np.argmax(answers)] == pytest.approx(0.15, abs=0.051)
    assert max(answers) == pytest.approx(0.72, abs=0.03)


@SHARED
def test_the_quadplane_has_all_its_parameters_and_its_stamps_are_no_sample_times() -> None:
    stamps, magics = records("vtol_quadplane")
    steps = np.diff(boot_s("vtol_quadplane"))
    assert len(np.unique(fields("vtol_quadplane")["PARAM_VALUE"]["param_id"])) == 1053
    assert (len(stamps), (np.diff(stamps) == 0).sum()) == (23894, 18850)
    assert np.unique(stamps, return_counts=True)[1].max() == 26
    assert set(magics.tolist()) == {0xFE}
    assert steps.min() == pytest.approx(-1.4)
    assert (steps < -0.1).sum() == 1


@SHARED
def test_the_copter_reboots_four_times_and_is_silent_for_59_s() -> None:
    stamps, _ = records("copter_sik_radio")
    reboots = [(a, b) for a, b in pairwise(boot_s("copter_sik_radio").tolist()) if b < a - 1.0]
    silences = np.diff(fields("copter_sik_radio")["ATTITUDE", "received_us"]) / 1e6
    expected = [(259.5, 16.0), (83.9, 17.8), (1188.0, 20.1), (861.1, 13.8)]
    assert np.array(reboots) == pytest.approx(np.array(expected), abs=0.06)
    assert silences.max() == pytest.approx(59.0, abs=0.5)
    assert (stamps[-1] - stamps[0]) / 60e6 == pytest.approx(41.0, abs=0.5)
