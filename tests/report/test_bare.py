"""The report on the bare airframe: next to the answer as flown, or why it is not known."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace

from yawid.answers.heard import LinkCounts
from yawid.answers.reasons import Reason, Verdict
from yawid.answers.run_summary import Bare, DutchRoll, RunSummary, TimeConstant, Value
from yawid.blocks import StampedRows
from yawid.report.bare import bare_section
from yawid.report.lateral_picture import acceleration
from yawid.sinks.pages import to_text
from yawid.sinks.run_page import summary_page
from yawid.sinks.words import bare_rows

USABLE = Verdict(usable=True, reasons=[])
KNOWN = Bare(
    dutch_roll=DutchRoll(wn_rad_s=2.41, wn_std=0.03, zeta=0.12, zeta_std=0.008, level=1),
    roll_mode=TimeConstant(0.25, 0.03), spiral=TimeConstant(-40.0, 12.0),
    derivatives={"N_beta": Value(5.7, 0.2), "N_delta_r": Value(-1.46, 0.05)},
    servo_lag_s=Value(0.14, 0.005), airspeed_m_s=50.0, used=[1, 3], verdict=USABLE,
)  # fmt: skip


def summary(bare: Bare | None) -> RunSummary:
    return RunSummary(
        log="a.tlog", duration_s=1.0, link=LinkCounts(), channels={}, verdict=USABLE, bare=bare
    )


def plain(html: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))


WHY = Reason("bare_unknown", "the aileron is a copy", weight="warning")
UNKNOWN = Bare(used=[1], verdict=Verdict(usable=False, reasons=[WHY], next="Move the rudder."))
GUESSED = replace(
    KNOWN, derivatives={"Y_beta": Value(-0.07, 0.05)}, from_prior=["Y_beta", "alpha_rad"]
)


@pytest.mark.parametrize(
    ("bare", "page", "rows"),
    [
        (KNOWN, ["5.70 ± 0.20", "a_my^β", " ωn 2.410 ± 0.030 rad/s, ζ 0.1200 ± 0.0080, "], [
            "wn 2.410 ± 0.030 rad/s, zeta 0.1200 ± 0.0080, level 1",
            "roll mode 0.250 ± 0.030 s, spiral -40 ± 12 s, servo lag 0.1400 ± 0.0050 s",
            "this is the airframe without its roll loop at 50.0 m/s (true airspeed), "
            "from 2 manoeuvres",
        ]),
        (GUESSED, ["What is known of aircraft beforehand gives Y_β/V, not the flight."], None),
        (UNKNOWN, ["not known: the aileron is a copy. Next: Move the rudder. (yawid explain"], [
            "the bare airframe is not known: the aileron is a copy",
            "next: Move the rudder. (yawid explain bare_unknown)",
        ]),
        (None, [""], []),
    ],
)  # fmt: skip
def test_page_and_terminal_say_what_is_known_of_the_bare_airframe(
    bare: Bare | None, page: list[str], rows: list[str] | None
) -> None:
    run = summary(bare)
    said, found = plain("".join(bare_section(run))), [row.text for row in bare_rows(run)]

    assert [each for each in page if each not in said] == []
    assert rows in (None, found)
    assert bool(said) == bool(found) == ("\n    bare  " in to_text(summary_page(run)))
    assert ("beforehand" in said) == (bare is GUESSED)
    if bare is KNOWN:
        assert [row[1:] for row in found[1:] if row[1:] not in said] == []


@pytest.mark.parametrize(("y_beta", "explained"), [(-0.3, True), (-0.6, False)])
def test_the_acceleration_is_that_of_the_side_force_at_the_sensor_s_place(
    y_beta: float, explained: bool
):
    """50 (Y_beta beta + 0.1 dr) + 0.5 r' - 0.2 p' + 0.04; the place and the offset are sought."""
    t = np.arange(0.0, 20.0, 0.02)
    beta, p, r, dr = 0.1 * np.sin(2.0 * t), 0.3 * np.sin(3.0 * t), np.sin(5.0 * t), np.cos(7.0 * t)
    ay = 50.0 * (-0.3 * beta + 0.1 * dr)
    ay += 0.5 * 5.0 * np.cos(5.0 * t) - 0.2 * 0.9 * np.cos(3.0 * t) + 0.04
    values = {"Y_beta": Value(y_beta, 0.1), "Y_delta_r": Value(0.1, 0.01)}
    bare = replace(KNOWN, derivatives=values, airspeed_m_s=50.0)
    t_us = np.rint(1e6 * t).astype(np.int64)
    rows = StampedRows(t_us, 1000 * t_us, np.column_stack([ay, t_us]))

    found = acceleration(
        bare, t_us, np.column_stack([beta, p, r, r]), np.column_stack([dr, dr]), rows
    )

    left = np.std((ay - found)[1:-1]) / np.std(ay)  # a difference quotient is one-sided at the ends
    assert left < 0.01 if explained else left > 0.1
