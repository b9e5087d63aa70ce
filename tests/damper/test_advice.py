"""The command yawid damper: whether a damper is needed at all, whether to fly more, and the mix."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import hand_flights
import numpy as np
import pytest
from damper.test_study import GIVEN, WN, record, studied
from damper.test_study import PLANE as PARAMETERS
from finished_runs import replayed
from models.answers_by_hand import flight, manoeuvre, response
from models.answers_by_hand import run_of as run_by_hand
from msgspec.structs import replace
from places import REPLAY_LOGS

import yawid
from yawid.answers.damper_report import Mix
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, Value
from yawid.cli import main as command_line
from yawid.damper.autopilots import AUTOPILOTS
from yawid.damper.mix import mix_of

PLANE = ("--autopilot=ardupilot", *(f"--param={name}={x}" for name, x in PARAMETERS.items()))


def asked(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict]:
    """Return a command's exit code and its one JSON object."""
    code = command_line.main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def flown(folder: Path, zeta: float) -> str:
    """Return the run of one manoeuvre of an aircraft with this damping."""
    return str(yawid.replay(record(zeta, (100, 160, 220)), **GIVEN).mcap(folder))


def test_an_aircraft_that_is_damped_enough_needs_no_gain_and_no_autopilot(
    tmp_path: Path, capsys
) -> None:
    log = flown(tmp_path, 0.6)
    assert command_line.main(["damper", log]) == 0
    printed = capsys.readouterr().out

    code, found = asked(capsys, "damper", log)

    assert (code, found["verdict"]["usable"]) == (0, True)
    assert [each["id"] for each in found["verdict"]["reasons"]] == ["no_autopilot"]
    zeta, std, sigmas = map(
        float, re.findall(r"zeta is (\S+) ± (\S+), (\S+) sigma", found["says"][0])[0]
    )
    assert found["says"][0].startswith("None is needed")
    assert abs(zeta - 0.6) < 2.0 * std
    # Both numbers are rounded to .01.
    assert sigmas == pytest.approx((zeta - 0.4) / std, rel=0.25)
    assert "recommended" not in found
    assert "none is recommended" in printed.splitlines()
    assert "None is needed" in printed


def test_a_damping_that_is_above_the_aim_by_less_than_its_sigma_is_not_called_enough(
    tmp_path: Path, capsys
) -> None:
    log = flown(tmp_path, 0.43)

    code, found = asked(capsys, "damper", log, *PLANE)
    said = " ".join(found["says"])
    assert code == 0
    assert "None is needed" not in said
    needed = r"No gain is recommended\. Without a damper zeta is 0\.4\d ± .* 1\.6 are needed"
    assert re.search(needed, said)
    # With an aim of .55 to .65 the same aircraft needs one.
    code, found = asked(capsys, "damper", log, *PLANE, "--aim", "0.6")
    assert (code, found["recommended"]["low"] > 0.0) == (0, True)


def by_hand(effect_std: float, noise: float, wn_std: float) -> Verdict:
    """Return the damper's verdict on two manoeuvres whose answers are written by hand.

    ``effect_std`` is the sigma of the rudder's effect in each of them, a part of it, ``noise`` the
    part of each sigma that noise explains, ``wn_std`` the flight's sigma of wn in rad/s.
    """
    pole, r = complex(-0.5, math.sqrt(24.75)), complex(3.0, 0.06)
    size = effect_std * np.array([r.real, r.imag])  # one number for both: a size of the response
    covariance = np.zeros((4, 4))
    covariance[2:, 2:] = np.outer(size, size)
    of = response([pole], {"rudder": [r]}, covariance + np.diag([0.05, 0.01, 0.0, 0.0]) ** 2)
    both = [manoeuvre(n, of, (10.0, 30.0), noise=noise) for n in (1, 2)]
    used = flight(both, WN, 0.1, 0.002)
    roll = replace(used.dutch_roll, wn_std=wn_std, wn_std_noise=noise * wn_std)
    none, swings = np.zeros(500), np.sin(0.25 * np.arange(500))
    columns = {"rudder": none, "r [rad/s]": swings, "roll [rad]": none}
    run = run_by_hand(columns, both, replace(used, dutch_roll=roll))
    return studied(run).report.verdict


def test_the_next_flight_is_asked_for_where_sigma_falls_enough() -> None:
    verdict = by_hand(0.02, 0.9, 0.35)

    assert verdict.why == "wn_uncertain"
    assert "wn has a sigma of 7 %" in verdict.reasons[0].text
    (more, left) = re.findall(r"(\d+) more should bring this sigma to (\S+) %", verdict.next)[0]
    # .9 of sigma is noise, which falls with the root of the manoeuvres; the rest stays.
    after = 0.07 * math.sqrt(1.0 - 0.81 + 0.81 * 2.0 / (2.0 + float(more)))
    assert float(left) == pytest.approx(100.0 * after, abs=0.1)
    assert float(left) <= 5.0


def test_an_effect_that_noise_hides_is_asked_for_and_one_that_structures_hide_is_not() -> None:
    known, noisy, hidden = (
        by_hand(std, noise, 0.02) for std, noise in ((0.1, 1.0), (0.45, 1.0), (0.3, 0.0))
    )

    assert known.usable
    assert (noisy.why, hidden.why) == ("gain_uncertain", "gain_uncertain")
    # Two manoeuvres of 45 % are known to 32 %, and six to 18 %.
    assert float(re.findall(r"sigma of (\S+) %", noisy.reasons[0].text)[0]) == pytest.approx(
        45.0 / math.sqrt(2.0), rel=0.15
    )
    assert float(re.findall(r"4 more should bring this sigma to (\S+) %", noisy.next)[0]) < 20.0
    assert "fly more" not in hidden.next
    assert float(re.findall(r"would leave this sigma at (\S+) %", hidden.next)[0]) == (
        pytest.approx(30.0, rel=0.15)
    )


SIMULATOR = REPLAY_LOGS / "sitl_fbwa_manoeuvres" / "log.tlog"
SETTINGS = ("--param=SCHED_LOOP_RATE=50", "--param=YAW2SRV_DAMP=0", "--param=SCALING_SPEED=15",
            "--param=AIRSPEED_MIN=12", "--param=AIRSPEED_MAX=30")  # fmt: skip


def test_arduplanes_simulator_is_damped_enough(tmp_path: Path, capsys) -> None:
    """Its Dutch roll has a zeta of .63."""
    run = replayed(SIMULATOR, tmp_path, "--from", 205)
    code, found = asked(capsys, "damper", str(run), *SETTINGS)

    assert code == 0
    assert found["says"][0].startswith("None is needed")
    assert "Leave YAW2SRV_DAMP at 0." in found["says"]


def told(bare: Bare | None, flown: float | None = 0.5, unit: float = 1.0, name="ardupilot") -> Mix:
    run = replace(
        hand_flights.summary([hand_flights.manoeuvre(1)], hand_flights.flight(used=[1])), bare=bare
    )
    return mix_of(run, AUTOPILOTS[name], flown, unit)


def known(value: float, std: float) -> Bare:
    derivatives = {"N_delta_a": Value(0.3, 0.01), "N_delta_r": Value(1.5, 0.01)}
    return Bare(
        rudder_mix=Value(value, std), derivatives=derivatives, airspeed_m_s=22.0, used=[1],
        verdict=Verdict(usable=True, reasons=[]),
    )  # fmt: skip


UNKNOWN = Reason("bare_unknown", "the aileron does not move", weight="warning")
TRAVEL = math.radians(30.0)


@pytest.mark.parametrize(
    ("bare", "options", "value", "said"),
    [
        (known(0.3, 0.05), {}, 0.3, ("KFF_RDDRMIX 0.30 rolls", "flown 0.5")),
        # A rudder in rad with 30 degrees of travel.
        (
            known(0.3 * TRAVEL, 0.05 * TRAVEL),
            {"flown": None, "unit": TRAVEL, "name": "px4"}, 0.3,
            ("FW_RLL_TO_YAW_FF", "an unknown mix"),
        ),
        (known(-0.1, 0.05), {}, -0.1, ("Leave KFF_RDDRMIX at 0 (found -0.10",)),
        (known(1.6, 0.09), {}, 1.6, ("KFF_RDDRMIX 1.00 rolls",)),
        # Less than sigma is not worth a change; a sigma of .1 or more is too large for any mix.
        (known(0.46, 0.05), {}, 0.46, ("Keep KFF_RDDRMIX 0.5 (found 0.46 ± 0.05",)),
        (known(1.6, 0.1), {}, None, ("1.6 ± 0.1",)),
        (None, {}, None, ("move the aileron as well, and replay that log",)),
        (
            Bare(used=[1], verdict=Verdict(usable=False, reasons=[UNKNOWN])), {}, None,
            ("the aileron does not move",),
        ),
        (known(0.3, 0.2), {}, None, ("0.3 ± 0.2",)),
    ],
)  # fmt: skip
def test_the_mix_is_given_in_parts_of_the_travel_within_the_parameters_limits_or_refused_in_words(
    bare: Bare | None, options: dict[str, Any], value: float | None, said: tuple[str, ...]
) -> None:
    found = told(bare, **options)

    assert (found.value, found.flown) == (pytest.approx(value), options.get("flown", 0.5))
    assert value is None or found.std == pytest.approx(bare.rudder_mix.std / options.get("unit", 1))
    for each in said:
        assert each in f"{found.parameter}: {found.text}"
