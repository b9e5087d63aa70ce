"""A run against its fleet: its own log, which the fleet has replayed too, is no witness."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from checks.judge_trend import START_US, flight
from finished_runs import replayed
from fleets import write_fleet
from forged_runs import forge
from hand_flights import four_of_a_flight
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.trend.days import DAY_US

OTHERS, OWN = (0.12, 0.16, 0.10, 0.14), 0.20
"""wn / V of four flights of the vehicle, and of the fifth, the run's."""
MEAN = 0.13
"""Of the four, their median too; of all five they are .144 and .14."""


def test_a_run_is_compared_with_the_other_flights_and_not_with_its_own_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    by_hand = four_of_a_flight().to_json()
    own = by_hand["flight"] | {"loop": "airframe", "kappa_rad_m": {"value": OWN, "std": 0.002}}

    def given(summary: Any) -> Any:
        return summary | {"manoeuvres": by_hand["manoeuvres"], "flight": own}

    short = replayed(C172P, tmp_path / "run", "--rate", 10, "--also", "none", "--manoeuvres", "off")
    run = forge(short, tmp_path / "run.mcap", summary=given)
    rows = [
        flight(1, i, START_US + i * 7 * DAY_US, kappa_rad_m=kappa, kappa_std=0.002)
        for i, kappa in enumerate((*OTHERS, OWN))
    ]
    rows[-1]["log_sha256"] = hashlib.sha256(C172P.read_bytes()).hexdigest()
    write_fleet(tmp_path / "fleet", rows)

    main(["diff", str(tmp_path / "fleet"), str(run), "--json"])

    said = printed("diff", capsys.readouterr().out)
    (kappa,) = [each for each in said["numbers"] if each["quantity"] == "kappa_rad_m"]
    assert kappa["a"]["value"] == pytest.approx(MEAN, abs=0.004)
    assert kappa["difference"] == pytest.approx(OWN - MEAN, abs=0.004)
