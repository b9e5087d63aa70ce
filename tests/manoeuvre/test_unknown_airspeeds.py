"""An airspeed that is no number of an aircraft is unknown: the flight is answered without kappa."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from finished_runs import replayed
from sources.logs import dataflash_flight, ulog_flight
from sources.logs.onboard_flight import Flight, flown

import yawid
from yawid.answers.run_summary import Flight as Answer
from yawid.cli.main import main
from yawid.quantities.airspeed import known

NONE = (0.0, -3.0, math.nan, 1e300)


def record(flight: Flight, airspeed_m_s: float) -> bytes:
    lines = ["t,rudder [half-travel],r [rad/s],roll [rad],airspeed"]
    for k, t in enumerate(flight.t):
        rudder = (flight.pwm[k] - 1500) / 400
        lines.append(f"{t:.2f},{rudder},{flight.rates[k, 2]},{flight.roll[k]},{airspeed_m_s}")
    return "\n".join(lines).encode()


SENT = (3, 5), dataflash_flight.PARAMETERS, 4
FORMATS: dict[str, Callable[[Flight, float], bytes]] = {
    "a.tlog": lambda f, sent: dataflash_flight.telemetry_of(f, *SENT, 17.0, sent).data,
    "a.bin": lambda f, sent: dataflash_flight.logged(f, airspeed_m_s=sent).data,
    "a.ulg": lambda f, sent: ulog_flight.logged(f, sent).data,
    "a.csv": record,
}


@pytest.fixture(scope="module")
def flight() -> Flight:
    return flown(25.0)


@pytest.mark.parametrize(
    ("name", "airspeed_m_s"),
    [
        *(("a.tlog", each) for each in NONE[1:]),
        *((name, 0.0) for name in FORMATS),
        ("a.csv", 1e300),
    ],
)
def test_a_flight_without_an_airspeed_is_answered_without_kappa(
    tmp_path: Path, flight: Flight, name: str, airspeed_m_s: float
) -> None:
    with np.errstate(over="ignore"):
        sent = airspeed_m_s if name == "a.csv" else float(np.float32(airspeed_m_s))  # its field
    (tmp_path / name).write_bytes(FORMATS[name](flight, sent))

    run = yawid.replay(tmp_path / name, rate=20.0)

    assert np.isnan(run.samples["airspeed"]).all()
    summary = run.summary
    assert summary.flight.dutch_roll.wn_rad_s == pytest.approx(4.0, rel=0.03)
    assert (summary.flight.kappa_rad_m, summary.flight.K_per_V) == (None, None)
    assert (summary.flight.airspeed_m_s, summary.flight.airspeed_source) == (None, None)


def test_the_bounds_are_next_to_nothing_and_three_times_sound() -> None:
    """What lies between is believed here: whether it may be true is another question."""
    speeds = np.array([0.09, 0.1, 1000.0, 1001.0, math.inf])

    np.testing.assert_array_equal(known(speeds), [math.nan, 0.1, 1000.0, math.nan, math.nan])


def test_a_blocked_pitot_leaves_the_flight_without_kappa_in_log_mcap_and_export(
    tmp_path: Path, flight: Flight
) -> None:
    log = tmp_path / "a.tlog"
    log.write_bytes(dataflash_flight.telemetry_of(flight, *SENT, 51.0, 0.9).data)

    mcap = replayed(log, tmp_path, "--rate", 20)
    assert main(["export", str(mcap), "-o", str(tmp_path / "a.csv")]) == 0

    flights: list[Answer] = []
    for path in (log, mcap, tmp_path / "a.csv"):
        rate = {"rate": 20.0} if path is log else {}
        found = yawid.replay(path, **rate).summary.flight
        flights.append(found)
        assert found.dutch_roll.wn_rad_s == pytest.approx(4.0, rel=0.03)
        assert (found.kappa_rad_m, found.K_per_V, found.airspeed_m_s) == (None, None, None)
        said = [each for each in found.verdict.reasons if each.id == "airspeed_implausible"]
        assert [each.weight for each in said] == ["warning"]
    assert flights[0] == flights[1]
