"""Which airspeed a record gives, and what the equivalent one is then.

Truth is the standard atmosphere's own table (ICAO Doc 7488) and the definitions of units.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from sources.records.test_record import settled

from yawid.blocks import RecordBlock
from yawid.errors import ConfigError, SourceError
from yawid.quantities.airspeed import (
    Kind,
    density_ratio,
    equivalent_of_calibrated,
    known,
)
from yawid.sources.records.find_columns import Asked

KNOT_M_S = 1852.0 / 3600.0
DENSITY = {0.0: 1.2250, 1000.0: 1.1116, 4000.0: 0.81913, 11_000.0: 0.36392, 15_000.0: 0.19367}
"""ICAO's table: geopotential altitude in m, density in kg/m^3."""


def rows_of(path: Path, head: str, cells: str, asked: Asked | None = None) -> RecordBlock:
    """A record of four rows that are alike, but for the time, the rudder and the yaw rate"""
    lines = [f"t,rudder [half-travel],r [rad/s],{head}"]
    lines += [f"{0.02 * k:.2f},{0.1 * k},{0.2 * k},{cells}" for k in range(4)]
    record = settled(path, "\n".join(lines), asked or Asked())
    return RecordBlock.joined([rows for _, rows in record.read() if rows])


TRUE_AT_4000_M = KNOT_M_S * np.sqrt(0.81913 / 1.2250)
"""100 ktas at 4000 m are 81.8 keas: 18 % less."""
AIRSPEEDS = {
    "airspeed [m/s]": (1.0, Kind.EQUIVALENT),
    "airspeed [km/h]": (1.0 / 3.6, Kind.EQUIVALENT),
    "airspeed [ft/s]": (0.3048, Kind.EQUIVALENT),
    "airspeed [mph]": (1609.344 / 3600.0, Kind.EQUIVALENT),
    "airspeed [kt]": (KNOT_M_S, Kind.EQUIVALENT),
    "airspeed_kn": (KNOT_M_S, Kind.EQUIVALENT),
    "airspeed [keas]": (KNOT_M_S, Kind.EQUIVALENT),
    "airspeed [knots EAS]": (KNOT_M_S, Kind.EQUIVALENT),
    "airspeed [kcas]": (KNOT_M_S, Kind.CALIBRATED),
    "airspeed [kias]": (KNOT_M_S, Kind.INDICATED),
    "airspeed_kias": (KNOT_M_S, Kind.INDICATED),
    "airspeed [m/s IAS]": (1.0, Kind.INDICATED),
}


@pytest.mark.parametrize("head", AIRSPEEDS)
def test_a_unit_is_what_it_is_by_definition_and_says_which_airspeed_it_is(
    tmp_path: Path, head: str
) -> None:
    found = rows_of(tmp_path / "a.csv", head, "36")
    m_s, kind = AIRSPEEDS[head]
    np.testing.assert_allclose(found.airspeed, 36.0 * m_s, rtol=1e-12)
    assert set(found.airspeed_kind) == {float(kind)}


BY_DENSITY = "TAS [m/s],altitude [ft],air_density [kg/m^3]", "50,13123,0.9"


@pytest.mark.parametrize(
    ("head", "cells", "asked", "expected", "rtol"),
    [
        *(
            (f"{name},altitude [m]", "100,4000", (), 100.0 * TRUE_AT_4000_M, 1e-4)
            for name in ("airspeed [ktas]", "airspeed_ktas", "airspeed [kt TAS]")
        ),
        # Density goes before altitude, and other names say what they are.
        (*BY_DENSITY, ("airspeed=TAS",), 50.0 * np.sqrt(0.9 / 1.225), 1e-9),
    ],
)
def test_a_true_airspeed_is_converted_by_the_altitude(
    tmp_path: Path, head: str, cells: str, asked: tuple[str, ...], expected: float, rtol: float
) -> None:
    found = rows_of(tmp_path / "a.csv", head, cells, Asked(columns=asked))
    np.testing.assert_allclose(found.airspeed, expected, rtol=rtol)
    assert set(found.airspeed_kind) == {float(Kind.TRUE)}


REFUSED = {
    "true, and no altitude": ("airspeed [ktas]", "100", "true airspeed.*'altitude=COLUMN"),
    "true, the altitude empty": ("airspeed [ktas],altitude [m]", "100,", "true airspeed"),
    "true, no number of an altitude": ("airspeed [ktas],altitude [m]", "100,1e7", "true airspeed"),
    "calibrated and fast, and no altitude": ("airspeed [kcas]", "400", "up to 206 m/s.*altitude"),
    "a ground speed that is a true airspeed": ("ground_speed [ktas]", "100", "its unit is 'ktas'"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_converted_is_refused_by_a_line_that_says_what_is_needed(
    tmp_path: Path, name: str
) -> None:
    head, cells, said = REFUSED[name]

    with pytest.raises((ConfigError, SourceError)) as refused:
        rows_of(tmp_path / "a.csv", head, cells)

    assert re.search(said, str(refused.value))
    assert "\n" not in str(refused.value)


def test_the_density_is_that_of_the_standard_atmosphere() -> None:
    heights = np.array(list(DENSITY))

    np.testing.assert_allclose(1.225 * density_ratio(heights), list(DENSITY.values()), rtol=1e-4)
    assert np.isnan(density_ratio(np.array([np.nan, 1e308, -1e4]))).all()


def test_slow_enough_a_calibrated_airspeed_is_the_equivalent_one_to_one_percent() -> None:
    """Of the measured pressure p0 ((1 + .2 M^2)^3.5 - 1) the two are readings by two formulas."""
    found = equivalent_of_calibrated(
        np.array([100.0, 100.0, 50.0]), np.array([0.0, 3000.0, 3000.0])
    )

    # At sea level both are the same by definition; at 3000 m the pressure is 70 109 Pa.
    impact = 101_325.0 * ((1.0 + 0.2 * (100.0 / 340.294) ** 2) ** 3.5 - 1.0)
    mach = np.sqrt(5.0 * ((impact / 70_109.0 + 1.0) ** (2.0 / 7.0) - 1.0))
    dynamic = 0.7 * 70_109.0 * mach**2
    np.testing.assert_allclose(found[:2], [100.0, np.sqrt(2.0 * dynamic / 1.225)], rtol=1e-4)
    assert 0.99 * 100.0 < found[1] < 100.0
    assert 0.99 * 50.0 < found[2] < 50.0


def test_an_exports_words_for_the_kind_are_read_and_others_refused(tmp_path: Path) -> None:
    head = "airspeed,ground_speed,airspeed_kind"
    found = rows_of(tmp_path / "a.csv", head, "30,31,calibrated")
    assert set(found.airspeed_kind) == {float(Kind.CALIBRATED)}
    np.testing.assert_array_equal(found.airspeed, 30.0)
    np.testing.assert_array_equal(found.ground_speed, 31.0)

    found = rows_of(tmp_path / "a.csv", head, ",31,ground")
    np.testing.assert_array_equal(known(found.airspeed), 31.0)
    np.testing.assert_array_equal(found.by_ground, 1.0)
    assert np.isnan(found.airspeed_kind).all()

    with pytest.raises(SourceError, match="'guessed' is not a kind of airspeed"):
        rows_of(tmp_path / "a.csv", head, "30,31,guessed")
