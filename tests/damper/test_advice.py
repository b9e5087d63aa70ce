"""``yawid damper``, the command: whether a damper is needed at all, and whether to fly more."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from places import REPLAY_LOGS
from recorded_flights import recorded
from scipy.signal import cont2discrete, lfilter

from yawid.cli import main as command_line

WN, V, DELTA = 5.0, 20.0, 6.0
"""The aircraft is r/u = 6 (s + 0.4) / (s^2 + 2 zeta 5 s + 25), flown at 20 m/s."""
PLANE = (
    "--autopilot=ardupilot", "--loop-rate=200", "--param=YAW2SRV_DAMP=0",
    "--param=SCALING_SPEED=20", "--param=AIRSPEED_MIN=10", "--param=AIRSPEED_MAX=30",
)  # fmt: skip


def record(path: Path, zeta: float, noise: float, starts: tuple[int, ...] = (100, 160, 220)) -> str:
    """Write doublets of an aircraft as a record at 20 Hz; ``noise`` is in rad/s."""
    u = np.zeros(starts[-1] + 980)
    for start in starts:
        u[start : start + 12], u[start + 12 : start + 24] = 0.3, -0.3
    b, a, _ = cont2discrete(([DELTA, 0.4 * DELTA], [1.0, 2.0 * zeta * WN, WN**2]), 0.05)
    r = lfilter(b.ravel(), a, u) + np.random.default_rng(1).normal(0.0, noise, len(u))
    rows = zip(10.0 + 0.05 * np.arange(len(u)), u, r, strict=True)
    lines = ["t,rudder [half travel],r [rad/s],airspeed [m/s EAS],roll [rad]"]
    lines += [f"{t:.2f},{a:.4f},{b:.6f},{V},0.0" for t, a, b in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(path)


def run_of(log: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[str, dict]:
    """Replay a record; return its MCAP and the answer."""
    _, answer = asked(capsys, "replay", log, "--rudder-unit", "half-travel", "--out", str(folder))
    return answer["files"]["mcap"], answer["flight"]


def asked(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict]:
    """Return a command's exit code and its one JSON object."""
    code = command_line.main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_an_aircraft_that_is_damped_enough_needs_no_gain_and_no_autopilot(
    tmp_path: Path, capsys
) -> None:
    log = record(tmp_path / "flight.csv", 0.6, 0.002)

    code, found = asked(capsys, "damper", log)

    assert code == 0
    assert found["verdict"]["usable"]
    assert [each["id"] for each in found["verdict"]["reasons"]] == ["no_autopilot"]
    zeta, std, sigmas = map(
        float, re.findall(r"zeta is (\S+) ± (\S+), (\S+) sigma", found["says"][0])[0]
    )
    assert found["says"][0].startswith("None is needed")
    assert abs(zeta - 0.6) < 2.0 * std
    # Both numbers are rounded to .01.
    assert sigmas == pytest.approx((zeta - 0.4) / std, rel=0.25)
    assert "recommended" not in found
    assert command_line.main(["damper", log]) == 0
    printed = capsys.readouterr().out
    assert "none is recommended" in printed.splitlines()
    assert "None is needed" in printed


def test_a_damping_that_is_above_the_aim_by_less_than_its_sigma_is_not_called_enough(
    tmp_path: Path, capsys
) -> None:
    log, _ = run_of(record(tmp_path / "flight.csv", 0.43, 0.002), tmp_path, capsys)

    code, found = asked(capsys, "damper", log, *PLANE)
    assert code == 0
    said = " ".join(found["says"])
    assert "None is needed" not in said
    assert re.search(
        r"No gain is recommended\. Without a damper zeta is 0\.4\d ± .* 1\.6 are needed", said
    )
    # With an aim of .55 to .65 the same aircraft needs one.
    code, found = asked(capsys, "damper", log, *PLANE, "--aim", "0.6")
    assert (code, found["recommended"]["low"] > 0.0) == (0, True)


def test_the_sigma_of_a_damper_is_that_of_the_mean_over_the_manoeuvres(
    tmp_path: Path, capsys
) -> None:
    starts = (100, 160, 220, 1000, 1060, 1120)
    log, flight = run_of(record(tmp_path / "flight.csv", 0.1, 0.002, starts), tmp_path, capsys)
    assert len(flight["used"]) == 2

    code, found = asked(capsys, "damper", log, *PLANE)

    assert code == 0
    (at,) = found["gains"][0]["at"]
    for name, tau in flight["between_std"].items():
        std = flight["dutch_roll"]["wn_std" if name == "wn_rad_s" else "zeta_std"]
        shown = at["wn_std" if name == "wn_rad_s" else "zeta_std"]
        assert shown == pytest.approx(math.sqrt(std**2 - tau**2), rel=0.15)
        assert shown < 0.9 * std


def test_the_next_flight_is_asked_for_where_sigma_falls_enough(tmp_path: Path, capsys) -> None:
    log, flight = run_of(record(tmp_path / "flight.csv", 0.4, 0.05), tmp_path, capsys)
    roll, tau = flight["dutch_roll"], flight["between_std"]["wn_rad_s"]
    noise2 = roll["wn_std_noise"] ** 2 + tau**2  # of the mean over one manoeuvre
    now, common2 = math.sqrt(roll["wn_std"] ** 2 - tau**2), roll["wn_std"] ** 2 - tau**2 - noise2

    code, found = asked(capsys, "damper", log, *PLANE)

    assert (code, found["verdict"]["reasons"][0]["id"]) == (5, "wn_uncertain")
    text, to_do = found["verdict"]["reasons"][0]["text"], found["verdict"]["next"]
    assert float(re.findall(r"sigma of (\S+) %", text)[0]) == pytest.approx(
        100.0 * now / roll["wn_rad_s"], abs=0.1
    )
    (more, left) = map(
        float, re.findall(r"(\d+) more should bring this sigma to (\S+) %", to_do)[0]
    )
    after = math.sqrt(common2 + noise2 / (1.0 + more))
    assert left == pytest.approx(100.0 * after / roll["wn_rad_s"], abs=0.1)
    assert left <= 5.0


SIMULATOR = REPLAY_LOGS / "sitl_fbwa_manoeuvres" / "log.tlog"
SETTINGS = ("--loop-rate=50", "--param=YAW2SRV_DAMP=0", "--param=SCALING_SPEED=15",
            "--param=AIRSPEED_MIN=12", "--param=AIRSPEED_MAX=30")  # fmt: skip


def test_no_manoeuvres_are_asked_for_that_would_not_help(capsys) -> None:
    """ArduPlane's simulator, zeta .63: two structures see different effects of the rudder."""
    code, found = asked(capsys, "damper", str(SIMULATOR), *SETTINGS)
    assert code == 0
    assert found["says"][0].startswith("None is needed")
    assert "Leave YAW2SRV_DAMP at 0." in found["says"]
    assert [each["id"] for each in found["verdict"]["reasons"]] == ["gain_uncertain"]

    code, found = asked(capsys, "damper", str(SIMULATOR), *SETTINGS, "--aim", "0.8")
    assert (code, found["verdict"]["reasons"][0]["id"]) == (5, "gain_uncertain")
    text, to_do = found["verdict"]["reasons"][0]["text"], found["verdict"]["next"]
    assert "fly more" not in to_do
    now = float(re.findall(r"sigma of (\S+) %", text)[0])
    left = float(re.findall(r"would leave this sigma at (\S+) %", to_do)[0])
    assert 20.0 < left <= now


@pytest.mark.long
@pytest.mark.parametrize("to_s", [130, 182, 241, 300])
@recorded("sitl_damp0")
def test_after_each_manoeuvre_of_the_simulator_none_is_needed(
    log: Path, to_s: int, tmp_path: Path, capsys
) -> None:
    assert command_line.main(["replay", str(log), "--to", str(to_s), "--out", str(tmp_path)]) == 0
    capsys.readouterr()

    code, found = asked(capsys, "damper", str(tmp_path / "sitl_damp0.mcap"))

    assert code == 0
    assert found["says"][0].startswith("None is needed")
