"""The bench of releases: its aircraft are what they say, and it misses its aim when it should."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from bench import releases
from bench.run import run
from flights.records import drawn_airframe, release, states


@pytest.mark.parametrize("rolls", [False, True])
@pytest.mark.parametrize(("wn", "zeta"), [(0.5, 0.02), (6.0, 0.15)])
def test_a_drawn_aircraft_has_the_dutch_roll_asked_for(wn: float, zeta: float, rolls: bool) -> None:
    A, B = drawn_airframe(np.random.default_rng(5), wn, zeta, 0.2, rolls=rolls)

    asked = wn * complex(-zeta, math.sqrt(1.0 - zeta**2))
    poles = np.linalg.eigvals(A)
    assert np.min(np.abs(poles - asked)) < 1e-9 * wn
    assert sum(pole.imag > 1e-6 for pole in poles) == 1
    assert bool(B[1]) == rolls


def test_a_held_rudder_is_simulated_exactly() -> None:
    rudder = np.array([0.0, 1.0, 1.0, -2.0, 0.0, 0.0])

    x = states(np.array([[-3.0]]), np.array([2.0]), rudder, 4.0)[:, 0]

    # x' = -3 x + 2 u: in .25 s with u held, x goes from x to e x + (1 - e) 2 u / 3
    e = math.exp(-0.75)
    expected = [0.0]
    for u in rudder[:-1]:
        expected.append(e * expected[-1] + (1.0 - e) * 2.0 * u / 3.0)
    np.testing.assert_allclose(x, expected, rtol=1e-13)


def test_a_release_is_a_doublet_of_half_a_period_each_way_and_hands_off() -> None:
    for number in range(8):
        columns, leg = release(1, number, 50, rolls=True)
        t, rudder = columns["t"], columns["rudder"]
        period_s = 2.0 * math.pi / leg.wn

        for side in (1.0, -1.0):
            assert np.sum(side * rudder > 0.0) / 50.0 == pytest.approx(period_s / 2.0, abs=0.04)
        off_s = t[-1] - t[np.flatnonzero(rudder)[-1]]
        assert max(4.9, 1.5 * period_s - 0.1) < off_s < 20.1
        assert {"p", "r", "roll"} < columns.keys()
        assert "roll" not in release(1, number, 50, rolls=False)[0]


def row(**own: Any) -> dict[str, Any]:
    return {
        "number": 0, "rate_hz": 10, "rolls": True, "answered": True, "fatal": "", "clock": "",
        "wrong": False, "wn_true": 0.6, "wn_off_pct": 0.1, "zeta_off": -0.01,
    } | own  # fmt: skip


@pytest.mark.parametrize(
    ("odd", "missed"),
    [
        ([], None),
        ([row(answered=False, fatal="poor_fit")] * 3, None),  # 3 of 108 are 2.8 %
        ([row(answered=False, fatal="poor_fit")] * 4, "4 of 108 refused, 0 wrong, 0 name a clock"),
        ([row(wrong=True)], "0 of 108 refused, 1 wrong, 0 name a clock"),
        ([row(clock="its clock")], "0 of 108 refused, 0 wrong, 1 name a clock"),
    ],
)
def test_the_aim_is_missed_by_refusals_wrong_answers_and_clocks(
    monkeypatch: pytest.MonkeyPatch, odd: list[dict[str, Any]], missed: str | None
) -> None:
    rows = iter(odd + [row()] * (108 - len(odd)))
    monkeypatch.setattr(releases, "row_of", lambda seed, task: [next(rows)])

    assert run("releases", ["--jobs", "1"])[1] == missed


def test_a_release_is_judged_against_its_own_aircraft() -> None:
    [found] = releases.row_of(9001, (0, 10))

    assert found["answered"]
    assert found["wn_off_pct"] == pytest.approx(100.0 * (found["wn"] / found["wn_true"] - 1.0))
    assert abs(found["wn_off_pct"]) < 2.0
    assert not found["wrong"]
