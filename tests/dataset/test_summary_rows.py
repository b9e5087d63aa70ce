"""A summary's numbers as the rows of a data set have them, by hand."""

from __future__ import annotations

import pytest
from hand_flights import manoeuvre, summary

from yawid.dataset.summary_rows import manoeuvre_rows


def test_kappa_and_k_over_v_and_all_their_sigmas_are_divided_by_the_airspeed() -> None:
    # wn 10.07, total sigma .11, of noise .03; K .308, .006, .002; V 21.6.
    (row,) = manoeuvre_rows(summary([manoeuvre(1, 10.07, speed=21.6)], None))

    expected = {
        "kappa_rad_m": 0.466_203_7,
        "kappa_std": 0.005_092_593,
        "kappa_std_noise": 0.001_388_889,
        "K_per_V": 0.014_259_26,
        "K_per_V_std": 0.000_277_777_8,
        "K_per_V_std_noise": 0.000_092_592_6,
    }
    assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("speed", "source"), [(21.6, "ground_speed"), (None, None)])
def test_without_an_airspeed_there_is_neither(speed: float | None, source: str | None) -> None:
    (row,) = manoeuvre_rows(summary([manoeuvre(1, speed=speed, airspeed_source=source)], None))

    assert not [name for name in row if name.startswith(("kappa", "K_per_V"))]
