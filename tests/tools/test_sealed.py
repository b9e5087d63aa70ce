"""The sealed aircraft: none on which a limit is chosen, and each has the mode that is noted."""

from __future__ import annotations

import csv
import re
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import accuracy
from bench import frame as runs
from bench.frame import main
from flights import plan as sealed
from flights.flight import Flight, Hands
from flights.linear import LinearAircraft
from flights.moved import AIRCRAFT
from flights.plan import Place
from flights.truth import linear_dutch_rolls, pulse_dutch_roll
from places import TOOLS
from scipy.integrate import solve_ivp
from scipy.linalg import expm

SEALED: dict[str, list[dict[str, Any]]] = tomllib.loads(
    (TOOLS / "flights" / "sealed.toml").read_text(encoding="utf-8")
)
SIZED = {"stall_rad", "damper_limit"}
"""What makes the mode of a linear aircraft depend on the size of the motion."""


def test_the_sealed_aircraft_are_sixteen_or_more_that_no_limit_was_chosen_on() -> None:
    of_jsbsim, own = ({each["aircraft"] for each in SEALED[of]} for of in ("jsbsim", "linear"))

    assert len(of_jsbsim) >= 6
    assert len(of_jsbsim | own) >= 16
    assert sum(not SIZED.isdisjoint(each) for each in SEALED["linear"]) >= 4
    opened = {place[0] for place in sealed.sealed_places(opened=True)}
    assert of_jsbsim.isdisjoint({each[0] for each in AIRCRAFT} | opened)
    assert of_jsbsim.isdisjoint(SEALED["excluded"])
    assert opened.isdisjoint(place[0] for place in sealed.sealed_places())


@pytest.mark.parametrize(
    "own",
    [*SEALED["linear"], *(pytest.param(own, marks=pytest.mark.long) for own in SEALED["jsbsim"])],
    ids=lambda own: str(own["aircraft"]),
)
def test_a_sealed_aircraft_has_the_dutch_roll_that_is_noted(own: dict[str, Any]) -> None:
    place = next(each for each in sealed.sealed_places() if each[0] == own["aircraft"])

    found = linear_dutch_rolls(sealed.plan_at(place))

    bare, off = found["dutch_roll_open_loop"], 0.005 if own in SEALED["jsbsim"] else 0.001
    assert (bare["wn_rad_s"], bare["zeta"]) == pytest.approx(own["modes"][0], rel=off, abs=0.001)
    assert found["dutch_roll"]["zeta"] < 0.6
    assert len(own["modes"]) == len(own.get("speeds_kt", [place[2]]))


@pytest.mark.long
@pytest.mark.parametrize(
    "place",
    [
        ("C130", 5000.0, 180.0), ("C130", 5000.0, 220.0), ("p51d", 5000.0, 160.0),
        ("p51d", 5000.0, 210.0),
        *(each for each in sealed.sealed_places() if not SIZED.isdisjoint(sealed.sealed(each[0]))),
    ],
    ids=str,
)  # fmt: skip
def test_the_decay_after_a_small_pulse_is_the_mode_that_is_noted(place: Place) -> None:
    own = sealed.sealed(place[0])
    plan = replace(sealed.plan_at(place), roll_gain=0.0, roll_rate_gain=0.0)

    seen = pulse_dutch_roll(plan)

    wn, zeta = own["modes"][own["speeds_kt"].index(place[2]) if "speeds_kt" in own else 0]
    assert seen["wn_rad_s"] == pytest.approx(wn, rel=0.01)
    assert seen["zeta"] == pytest.approx(zeta, abs=0.006)


@pytest.mark.long
@pytest.mark.parametrize("place", [("C130", 5000.0, 180.0), ("p51d", 5000.0, 210.0)], ids=str)
def test_an_aircraft_without_thrust_keeps_speed_and_altitude_in_air_that_rises(
    place: Place,
) -> None:
    flight = Flight(replace(sealed.plan_at(place), true_feedback=True), Hands())

    flight.advance_to(20_000)

    assert flight["velocities/vc-kts"] == pytest.approx(place[2], rel=0.002)
    assert flight["position/h-sl-ft"] == pytest.approx(place[1], abs=10.0)
    assert flight["propulsion/engine/set-running"] == 0.0
    assert flight["atmosphere/wind-down-fps"] < -10.0


def test_large_motions_are_those_of_a_stalled_fin_and_a_limited_damper() -> None:
    own = sealed.sealed("business_jet")
    stall, gain, limit = own["stall_rad"], own["damper_gain"], own["damper_limit"]
    column = np.array([own["Y_delta_r"], 0.0, own["L_delta_r"], own["N_delta_r"]])

    def motion(_: float, x: np.ndarray) -> np.ndarray:
        beta, roll, p, r = x
        fin = stall * np.tanh(beta / stall)
        bare = [
            own["Y_beta"] * fin - r + 9.80665 / own["airspeed_m_s"] * np.sin(roll),
            p,
            own["L_beta"] * fin + own["L_p"] * p + own["L_r"] * r,
            own["N_beta"] * fin + own["N_p"] * p + own["N_r"] * r,
        ]
        return bare + column * np.clip(-gain * r, -limit, limit)

    start = [0.3, 0.1, -0.2, 0.4]
    aircraft = LinearAircraft(own, sealed.plan_at(("business_jet", 1000.0, 200.0)))
    aircraft._x[:4] = start

    for _ in range(3000):
        aircraft.run()

    there = solve_ivp(motion, (0.0, 3.0), start, rtol=1e-8, atol=1e-10).y[:, -1]
    assert aircraft._x[:4] == pytest.approx(there, abs=5e-4)
    small = expm(3.0 * aircraft.A) @ start
    assert np.abs(small - there).max() > 0.05


OWN = """
jsbsim = []
[[linear]]
aircraft = "paper"
airspeed_m_s = 25.0
servo_lag_s = 0.05
roll_gain = 0.5
roll_rate_gain = 0.05
Y_beta = -0.3
L_beta = -15.0
L_p = -7.0
L_r = 2.0
N_beta = 8.0
N_p = -0.4
N_r = -0.8
Y_delta_r = -0.05
L_delta_a = 30.0
L_delta_r = -1.0
N_delta_a = -1.0
N_delta_r = 6.0
"""
"""An aircraft of this test's: a bench never answers about a sealed one before its time."""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of one commit, whose one sealed aircraft is linear."""
    (tmp_path / "tools" / "flights").mkdir(parents=True)
    own = tmp_path / "tools" / "flights" / "sealed.toml"
    own.write_text(OWN, encoding="utf-8")
    (tmp_path / runs.FILE).write_text("date,commit,bench,seed,figures\n", encoding="utf-8")
    git(tmp_path, "init", "--quiet")
    commit(tmp_path)
    monkeypatch.setattr(sealed, "PATH", own)
    monkeypatch.setattr(runs, "ROOT", tmp_path)
    return tmp_path


def git(folder: Path, *arguments: str) -> str:
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    return subprocess.run(
        ["git", *who, *arguments],
        cwd=folder, check=True, capture_output=True, encoding="utf-8", timeout=60,
    ).stdout.strip()  # fmt: skip


def commit(folder: Path) -> None:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "x")


def noted(folder: Path) -> list[dict[str, str]]:
    with (folder / "tools" / "flights" / "sealed.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_linear_aircraft_does_after_a_pulse_what_its_matrices_say(project: Path) -> None:
    plan = sealed.plan_at(*sealed.sealed_places())

    closed = linear_dutch_rolls(plan)["dutch_roll"]
    seen = pulse_dutch_roll(plan)

    bare = linear_dutch_rolls(replace(plan, roll_gain=0.0, roll_rate_gain=0.0))["dutch_roll"]
    assert seen == pytest.approx(closed, rel=0.003)
    assert abs(bare["zeta"] - closed["zeta"]) > 0.01


@pytest.mark.parametrize(
    ("bench", "few"),
    [
        pytest.param("lateral", ["--flights", "1"], marks=pytest.mark.long),
        pytest.param("truth", ["--flights", "1"], marks=pytest.mark.long),
        ("verdict", []),
        pytest.param("ordinary", ["--jsbsim", "1", "--seconds", "8"], marks=pytest.mark.long),
    ],
)
def test_a_sealed_run_appends_a_row_for_its_commit_and_only_one(
    bench: str, few: list[str], project: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setattr(accuracy, "SEALED", {"excited": 1})
    line = [bench, "--sealed", "--jobs", "1", *few]
    head = git(project, "rev-parse", "HEAD")

    main(line)

    assert "paper |" in capsys.readouterr().out or bench == "verdict"
    [row] = noted(project)
    assert (row["commit"], row["bench"]) == (head, bench)
    assert int(row["seed"]) == int(head[:8], 16) % 1_000_000
    assert re.match("count [01]; |excited 1, |flights 1; ", row["figures"])
    with pytest.raises(SystemExit, match="one for a commit"):
        main(line)
    (project / "limit.py").write_text("x = 1\n", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"not committed:\n\?\? limit.py"):
        main(line)
    assert noted(project) == [row]
