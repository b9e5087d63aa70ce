"""``yawid step`` and ``yawid simulate`` from the outside."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from printed import printed

from yawid.cli.main import main


def write(path: Path, function, seconds: float = 20.0) -> Path:
    rows = [f"{0.05 * i},{function(0.05 * i):.9g}" for i in range(round(seconds / 0.05))]
    path.write_text("t,y\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def first_order(t: float) -> float:
    return 2.0 * (1.0 - math.exp(-t / 1.5))


def second_order(t: float) -> float:
    D, q = 0.3, 2.0
    root = math.sqrt(1.0 - D * D)
    return 3.0 * (1.0 - math.exp(-D * q * t) / root * math.sin(q * root * t + math.acos(D)))


def test_step_responses_give_the_numbers_of_their_form_and_no_other_form(tmp_path: Path, capsys):
    first = str(write(tmp_path / "h1.csv", first_order))
    second = str(write(tmp_path / "h2.csv", second_order))

    assert main(["step", first, "--u0", "0.5", "--json"]) == 0
    report = printed("step", capsys.readouterr().out)
    assert report["model"] == "first"
    assert report["parameters"]["K"]["value"] == pytest.approx(4.0, rel=1e-6)
    assert report["parameters"]["T"]["value"] == pytest.approx(1.5, rel=1e-6)
    assert report["settling_5pct_s"]["value"] == pytest.approx(1.5 * math.log(20.0), rel=1e-6)
    assert main(["step", second, "--json"]) == 0
    found = printed("step", capsys.readouterr().out)["parameters"]
    assert [round(found[name]["value"], 5) for name in ("k", "D", "q")] == [3.0, 0.3, 2.0]
    assert main(["step", first, "--model", "second"]) == 5
    assert "overshoot" in capsys.readouterr().err


def test_the_airframe_of_the_lateral_plant_is_found_in_its_tlog(tmp_path: Path, capsys):
    """Eq. 21 with the reference coefficients; beta, p, r and roll positive to the right."""
    log = tmp_path / "lateral.tlog"
    options = ["--noise", "0.002", "--seconds", "40"]
    assert main(["simulate", "lateral", "--out", str(log), *options]) == 0
    capsys.readouterr()
    lateral = ["--lateral", "auto", "--servo-lag", "0"]
    assert main(["replay", str(log), "--out", str(tmp_path), "--json", *lateral]) == 0
    found = json.loads(capsys.readouterr().out)["bare"]

    motion = [[-0.3, 0, -1, 9.80665 / 50], [-15, -8, 1.5, 0], [5.5, -0.2, -0.7, 0], [0, 1, 0, 0]]
    poles = np.linalg.eigvals(motion)
    pair, fastest = poles[poles.imag > 0.0][0], poles.real.min()
    assert found["dutch_roll"]["wn_rad_s"] == pytest.approx(abs(pair), rel=0.005)
    assert found["dutch_roll"]["zeta"] == pytest.approx(-pair.real / abs(pair), abs=0.002)
    roll = found["roll_mode"]  # the rudder alone hardly shows it
    assert roll["time_constant_s"] == pytest.approx(-1.0 / fastest, abs=2.0 * roll["std"])


def test_the_lateral_plant_s_table_has_every_channel_and_its_acceleration(tmp_path: Path, capsys):
    """5.5 beta is what r' has beyond -0.2 p - 0.7 r + 4 dr, and ay = -0.3 beta 50 m/s."""
    out = tmp_path / "lateral.csv"
    out.touch()
    options = ["--out", str(out), "--seconds", "30", "--rate", "200", "--force"]
    assert main(["simulate", "lateral", *options]) == 0

    named = np.genfromtxt(out, delimiter=",", names=True)[1:]
    assert set(named.dtype.names) >= {"p", "q", "r", "roll", "pitch", "ay", "aileron", "airspeed"}
    r, p = ((x[1:] + x[:-1]) / 2 for x in (named["r"], named["p"]))
    u = named["rudder"][:-1]  # held
    beta = (np.diff(named["r"]) * 200 + 0.2 * p + 0.7 * r - 4.0 * u) / 5.5
    ay = (named["ay"][1:] + named["ay"][:-1]) / 2
    assert np.abs(ay - -0.3 * 50 * beta).max() < 1e-3 * np.abs(ay).max()
