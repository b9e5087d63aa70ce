"""One airframe from one aircraft: several that are pooled, reversed surfaces, causes and remedies.

All flights are of a linear aircraft whose equations the tests know, see changing_flights.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from changing_flights import LIGHT, Leg, at_speed, dutch_roll, tlog

import yawid
from yawid.cli.main import main

FLAPS = LIGHT | {"N_beta": 3.6, "N_r": -0.8, "L_p": -4.6}
DAMPED = LIGHT | {"N_r": -1.6}
LAG_S = 0.05
RUNS: dict[str, Any] = {}
"""By legs and options."""
DIMENSIONS = [
    "--aircraft",
    "mass=1000,ixx=1000,izz=2000,ixz=10,area=16,span=11,rudder-max-deg=20,aileron-max-deg=15",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flights")


def airframe(folder: Path, legs: list[Leg], *, lag_s: float | None = LAG_S, **changed: Any) -> Any:
    """Return the run of a flight, given the lag and made once; its log stays in the folder."""
    key = repr((legs, lag_s, changed))
    if key not in RUNS:
        path = folder / f"flight{len(RUNS)}.tlog"
        path.write_bytes(tlog(legs, **changed))
        RUNS[key] = yawid.replay(path, lateral="auto", servo_lag=lag_s)
    return RUNS[key]


def warnings(bare: Any) -> dict[str, str]:
    return {reason.id: reason.text for reason in bare.verdict.reasons}


@pytest.mark.parametrize("manual", [False, pytest.param(True, marks=pytest.mark.long)])
def test_two_aircraft_of_one_flight_have_no_airframe_in_common(folder: Path, manual: bool):
    """With flaps wn is 2.08 for 2.50 rad/s: the mean, 2.26, is the airframe of neither."""
    run = airframe(folder, [Leg(), Leg(FLAPS)], manual=manual)

    each = [m.lateral.dutch_roll.wn_rad_s for m in run.summary.manoeuvres]
    assert each == pytest.approx([dutch_roll()[0], dutch_roll(FLAPS)[0]], rel=0.02)
    assert not run.bare
    assert run.bare.dutch_roll is None
    assert "do not show one airframe" in run.bare.verdict.reasons[0].text
    assert run.bare.verdict.next == "Replay each manoeuvre by itself with --from and --to."


def test_two_dampings_at_one_frequency_are_two_aircraft(folder: Path):
    run = airframe(folder, [Leg(), Leg(DAMPED)])

    assert dutch_roll(DAMPED)[0] == pytest.approx(dutch_roll()[0], rel=0.01)
    assert not run.bare
    assert "zeta 0.33" in run.bare.verdict.reasons[0].text


def test_a_frozen_airspeed_is_no_airframe_and_the_true_one_is(folder: Path):
    speeds = (40.0, 50.0, 60.0)
    true = airframe(folder, [Leg(at_speed(v), v) for v in speeds]).bare
    frozen = airframe(folder, [Leg(at_speed(v), v, 50.0) for v in speeds]).bare

    assert true.used == [1, 2, 3]
    assert true.dutch_roll.wn_rad_s == pytest.approx(dutch_roll()[0], rel=0.02)
    assert not frozen
    assert "do not show one airframe" in frozen.verdict.reasons[0].text


def test_one_of_four_that_differs_is_left_out_with_a_warning(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    (folder / "four.tlog").write_bytes(tlog([Leg(), Leg(), Leg(FLAPS), Leg()]))
    main(["replay", str(folder / "four.tlog"), "--lateral", "auto", "--servo-lag", str(LAG_S),
          "--out", str(folder / "out")])  # fmt: skip
    printed = " ".join(capsys.readouterr().out.split())
    bare = yawid.load(folder / "out/four.mcap").bare

    assert bare.used == [1, 2, 4]
    assert bare.dutch_roll.wn_rad_s == pytest.approx(dutch_roll()[0], rel=0.02)
    assert warnings(bare)["manoeuvres_disagree"].startswith("manoeuvre 3 has wn 2.0")
    assert "warning manoeuvres disagree: manoeuvre 3 has wn 2.0" in printed


def test_the_airframe_is_that_of_the_flight_where_only_the_sticks_flew(folder: Path):
    """Four manoeuvres without an airspeed give the answer as flown, the fifth has flaps.

    Of three the one with flaps, which is better known, has a third of the weight.
    """
    nan = float("nan")
    run = airframe(folder, [*[Leg(told_m_s=nan)] * 4, Leg(FLAPS)], manual=True)

    assert run.flight.used == [1, 2, 3, 4]
    assert run.summary.manoeuvres[4].lateral.verdict.usable
    assert not run.bare
    assert "differs from the answer as flown" in run.bare.verdict.reasons[0].text


def test_a_pool_that_scatters_beyond_the_limit_of_sigma_is_none(folder: Path):
    """2.36 and 2.59 rad/s are 9 % apart: both agree, and their mean is not known to 4 %."""
    low, high = LIGHT | {"N_beta": 4.83}, LIGHT | {"N_beta": 5.92}
    run = airframe(folder, [Leg(low), Leg(high)])

    away = dutch_roll(high)[0] / dutch_roll(low)[0] - 1.0
    assert 0.085 < away < 0.095
    assert not run.bare
    assert run.bare.verdict.reasons[0].text.startswith("sigma of wn is 0.04")


@pytest.mark.parametrize(
    ("given_s", "gust_rad"),
    [
        (0.1, 0.0),
        *(pytest.param(*each, marks=pytest.mark.long) for each in ((0.0, 0.0), (0.15, 0.005))),
    ],
)
def test_a_servo_lag_that_the_flight_contradicts_is_a_warning_with_both_numbers(
    folder: Path, given_s: float, gust_rad: float
):
    """The servo's lag is .05 s."""
    right = airframe(folder, [Leg()], gust_rad=gust_rad).bare
    wrong = airframe(folder, [Leg()], gust_rad=gust_rad, lag_s=given_s).bare

    assert right.verdict.usable
    assert "lag_differs" not in warnings(right)
    said = warnings(wrong)["lag_differs"]
    assert said.startswith(f"the servo lag given is {given_s:g} s")
    found, std = map(float, said.split("finds ")[1].removesuffix(" s").split(" ± "))
    assert abs(found - LAG_S) < 3.0 * std


@pytest.mark.parametrize(
    ("later", "at", "seed"),
    [
        (FLAPS, 0.12, 12),
        pytest.param(FLAPS, 0.16, 16, marks=pytest.mark.long),
        pytest.param(LIGHT | {"N_r": -1.2}, 0.12, 12, marks=pytest.mark.long),
    ],
)
def test_an_aircraft_that_changes_within_a_manoeuvre_has_no_airframe(
    folder: Path, later: dict[str, float], at: float, seed: int
):
    """One fit lies between both, more than 3 of its sigmas from either, and each half shows it."""
    changed = airframe(folder, [Leg(later=later, at=at)], seed=seed)
    same = airframe(folder, [Leg()], seed=seed)

    assert same.bare
    assert not changed.bare
    assert "parts of the record are" in changed.bare.verdict.reasons[0].text
    assert "--from and --to" in changed.bare.verdict.next
    for verdict in (changed.flight.verdict, changed.summary.manoeuvres[0].verdict):
        said = {reason.id: reason.text for reason in verdict.reasons}
        assert "wn and zeta lie between them" in said["airframe_changes"]
    assert "airframe_changes" not in {each.id for each in same.flight.verdict.reasons}


@pytest.fixture(scope="module")
def reversed_aileron(folder: Path) -> Any:
    turned = LIGHT | {"L_delta_a": -8.0, "N_delta_a": -0.1}
    return airframe(folder, [Leg(turned)], manual=True)


def test_a_reversed_aileron_is_a_warning_and_gives_no_mix(reversed_aileron: Any):
    bare = reversed_aileron.bare

    assert bare
    assert bare.derivatives["L_delta_a"].value == pytest.approx(-8.0, rel=0.1)
    assert warnings(bare)["wrong_sign"].startswith("a positive aileron rolls the aircraft left")
    assert "SERVOn_REVERSED" in bare.verdict.next
    assert bare.rudder_mix is None
    mix = reversed_aileron.damper().report.mix
    assert mix.value is None
    assert mix.text.startswith("no mix is advised: a positive aileron rolls the aircraft left")


def test_a_reversed_rudder_is_a_warning_and_gives_no_mix(folder: Path):
    bare = airframe(folder, [Leg(LIGHT | {"N_delta_r": -2.5, "L_delta_r": 0.5})]).bare
    right = airframe(folder, [Leg()]).bare

    assert bare
    assert warnings(bare)["wrong_sign"].startswith("a positive rudder turns the nose left")
    assert bare.rudder_mix is None
    assert right.rudder_mix is not None
    assert right.verdict.reasons == []


@pytest.mark.parametrize("suffix", ["json", pytest.param("mat", marks=pytest.mark.long), "xml"])
def test_a_model_with_a_reversed_aileron_says_so_in_its_file_and_on_stderr(
    reversed_aileron: Any, folder: Path, suffix: str, capsys: pytest.CaptureFixture[str]
):
    out = folder / f"model.{suffix}"
    given = ["--what", "model", "--of", "bare", "-o", str(out), "--force", *DIMENSIONS]

    assert main(["export", str(reversed_aileron.path), *given]) == 0

    assert "warning wrong_sign: a positive aileron rolls" in capsys.readouterr().err
    if suffix == "mat":
        from scipy.io import loadmat

        said = str(loadmat(out)["reasons"])
    else:
        said = out.read_text(encoding="utf-8")
    assert "wrong_sign: a positive aileron rolls the aircraft left" in " ".join(said.split())


def test_each_cause_has_its_remedy_and_the_one_that_decides_comes_first(folder: Path):
    """At 10 Hz a fit of a held aileron neither settles nor shows the lag, in the calmest air."""
    bare = airframe(folder, [Leg()], lag_s=None, rate_hz=10, aileron=0.0, hold=(0.6, 0.2)).bare

    causes = bare.verdict.reasons[0].text.split("; ")
    assert causes[0].startswith("in one sample the fastest mode turns or decays by")
    assert bare.verdict.next.startswith("Send the attitude at a higher rate.")
    assert 1 < bare.verdict.next.count(".") <= len(causes)
    assert "calmer air" not in bare.verdict.next
