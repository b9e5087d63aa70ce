"""The verdict as a whole, on flights with a known truth and on logs that cannot answer."""

from __future__ import annotations

import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from flightlog import summarised
from flights import quiet as corpus_quiet
from flights.flight import Hands
from flights.fly import Made, fly
from flights.hands import by_hand
from flights.moved import SEED
from flights.plan import FlightPlan
from flights.surgery import message_id, payload, split
from flights.telemetry import Link
from gate import one_in
from scipy.signal import welch

from yawid.config.run import RunConfig
from yawid.results.reasons import Verdict
from yawid.runs.choose_orders import with_orders
from yawid.runs.inspect_log import inspect
from yawid.runs.job import open_log

TRUE_WN = 1.287
"""By JSBSim's own linearisation at the mean speed flown, of the flight with the line."""


def line_on_the_gyro() -> Made:
    """Fly a Dutch roll near 1.3 rad/s by hand, and add a vibration of 2.4 Hz to the gyro.

    The vibration has 17 % of the yaw rate's power and is not a mode of the aircraft, so 15.1 rad/s
    must not be the answer. The flight is as it was when that mistake was found, with an autopilot
    whose sensors have no noise.
    """
    rng = np.random.default_rng([SEED, 2])
    plan = FlightPlan(
        aircraft="t6texan2", speed_kt=138.0, altitude_ft=5000.0, seconds=120.0, manoeuvre="none",
        true_feedback=True,
    )  # fmt: skip
    hands = Hands(rudder=by_hand(rng, plan.seconds, amplitude=0.12, unit_s=1.5))
    made = fly(plan, Link(attitude_hz=25.0, servo_hz=25.0), hands, group="line", line_hz=2.4)
    return Made(corpus_quiet.with_line(made.log, 2.4, 0.17, rng), made.truth)


@pytest.fixture(scope="module")
def line() -> Made:
    return line_on_the_gyro()


@pytest.fixture(scope="module")
def lined(line: Made, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("lined") / "line.tlog"
    path.write_bytes(line.log)
    return path


def judged(log: Path, config: RunConfig) -> Verdict:
    return summarised(log, config)[1]


def test_a_line_on_the_gyro_is_no_dutch_roll_whatever_the_fit(lined: Path):
    """It was 15.2 rad/s, usable, with fits of 60 and 57 %."""
    stretch = RunConfig(rate=25.0, forgetting=1.0, from_s=35.0, to_s=148.0, manoeuvres="off")

    for config in (RunConfig(manoeuvres="off"), stretch):
        texts = {reason.id: reason.text for reason in judged(lined, config).reasons}
        assert "2.40 Hz" in texts["mode_not_driven"]
        assert "--band 0.0" in texts["mode_not_driven"]


def test_the_line_has_its_share_and_a_band_below_it_gives_the_true_mode(line: Made, lined: Path):
    frames = (frame for _, frame in split(line.log) if message_id(frame) == 30)  # ATTITUDE
    yaw_rate = np.array([struct.unpack("<f", payload(frame, 28)[24:])[0] for frame in frames])
    hz, power = welch(yaw_rate, fs=25.0, nperseg=512)
    assert power[(hz > 2.2) & (hz < 2.6)].sum() / power.sum() == pytest.approx(0.17, abs=0.03)
    assert line.truth is not None
    true = line.truth["dutch_roll"]
    assert true["wn_rad_s"] == pytest.approx(1.3, abs=0.03)

    banded = RunConfig(rate=5.0, forgetting=1.0, band=(0.05, 1.0))
    estimates = summarised(lined, banded)[0].estimates or {}

    for method in ("els", "rml"):
        found = estimates[method].dutch_roll
        assert found is not None
        assert found.wn_rad_s == pytest.approx(true["wn_rad_s"], rel=0.03)
        assert found.zeta == pytest.approx(true["zeta"], abs=0.03)


@pytest.mark.slow
def test_choosing_the_orders_by_the_log_does_not_make_the_line_usable(lined: Path):
    with closing(open_log(lined, again=True)) as source:
        verdict = judged(lined, with_orders(source, RunConfig(orders="auto", manoeuvres="off")))

    assert "mode_not_driven" in {reason.id for reason in verdict.reasons}


@pytest.mark.slow
@pytest.mark.parametrize("given", [{}, {"orders": "auto"}], ids=["default", "auto"])
def test_a_second_try_finds_the_mode_below_the_line(lined: Path, given: dict[str, str]):
    with closing(open_log(lined, again=True)) as source:
        summary, verdict = summarised(lined, with_orders(source, RunConfig(**given)))

    assert verdict.usable
    assert summary.manoeuvres is not None
    first, second = (summary.manoeuvres[0].tries or [])[:2]
    assert "mode_not_driven" in first.reasons
    assert second.answers
    assert second.band_hz is not None
    assert second.band_hz[1] < 2.4
    assert summary.flight is not None
    assert summary.flight.dutch_roll is not None
    assert summary.flight.dutch_roll.wn_rad_s == pytest.approx(TRUE_WN, rel=0.03)


@pytest.mark.slow
def test_inspect_recommends_the_replay_whose_second_try_answers(lined: Path):
    report, verdict = inspect(lined, {})

    assert verdict.usable
    assert report.command == f"yawid replay {lined}"
    assert summarised(lined, RunConfig())[1] == verdict


REMEDY = RunConfig(forgetting=1.0, turn="remove", band=(0.15, 3.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", one_in(7, range(len(corpus_quiet.KINDS))), ids=list(corpus_quiet.KINDS)
)
def test_what_nobody_excited_is_not_usable(
    kind: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """One of each kind; tools/bench.py verdict judges fifteen of each."""
    unknown = {"dutch_roll": None, "dutch_roll_open_loop": None}  # a truth takes seconds
    monkeypatch.setattr("flights.fly.truth_lines", lambda *_: unknown)
    log = tmp_path / "quiet.tlog"
    log.write_bytes(corpus_quiet.unexcited(kind).log)

    for config in (RunConfig(), RunConfig(forgetting=1.0), REMEDY):
        assert not judged(log, config).usable
