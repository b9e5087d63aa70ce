"""The answer of one manoeuvre, on a plant whose Dutch roll is known."""

import json
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from manoeuvre.streams import HZ, TS_S, WN, ZETA, doublets, flown, rest, stream, yawing
from places import C172P
from scipy.signal import butter, lfilter
from yawid.manoeuvres.answer import BOTH, OTHER_ORDERS, Answered, ManoeuvreSetting
from yawid.manoeuvres.tries import answer

from yawid.blocks import Floats, SampleBlock
from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.estimation.methods import METHODS

NOISE = 0.002
MANUAL, FBWA = 0.0, 5.0


def told(samples: SampleBlock, **options: Any) -> Answered:
    return answer(samples, 7, ManoeuvreSetting(RunConfig(**options), TS_S, (20.0, 20.0), (3, 1)))


def prbs(seconds: float, amplitude: float, seed: int) -> Floats:
    """Pulses of 0.3 s that go either way"""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], size=round(seconds * HZ / 6) + 1)
    return amplitude * np.repeat(signs, 6)[: round(seconds * HZ)]


RUDDER = flown(rest(1), prbs(30, 0.2, 1), rest(5))
AILERON = flown(rest(1), prbs(30, 0.1, 2), rest(5))


def flight(aileron: Floats | float = 0.0, **options: Any) -> SampleBlock:
    y = yawing(RUDDER, aileron, noise=NOISE)
    return stream(RUDDER, y=options.pop("y", y), aileron=aileron, **options)


def assert_right(found: Answered, wn_share: float = 0.02) -> None:
    roll = found.found.dutch_roll
    assert roll.wn_rad_s == pytest.approx(WN, rel=wn_share)
    assert roll.zeta == pytest.approx(ZETA, abs=0.02)
    assert abs(roll.wn_rad_s - WN) < 4.0 * roll.wn_std
    assert abs(roll.zeta - ZETA) < 4.0 * roll.zeta_std


def test_it_is_the_plants_dutch_roll():
    found = told(flight())

    assert_right(found)
    manoeuvre = found.found
    assert manoeuvre.n == 7
    assert manoeuvre.inputs == ["rudder"]
    assert str(manoeuvre.orders) == "3,3,2,1"
    assert not manoeuvre.turn_removed
    assert list(manoeuvre.estimates) == ["oe", "rml", "els"]
    assert manoeuvre.verdict.method == "oe"
    assert manoeuvre.verdict.usable
    assert found.span_ns == (int(flight().unix_ns[0]), int(flight().unix_ns[-1]))
    els = manoeuvre.estimates["els"].dutch_roll
    assert els.wn_rad_s == pytest.approx(WN, rel=0.05)


def test_memory_and_forgetting_are_the_streams():
    usual = told(flight())
    for options in ({"memory": 3.0}, {"forgetting": 0.9}):
        other = told(flight(), **options)
        assert other.found.estimates == usual.found.estimates
        assert other.found.estimates["rml"].forgetting_factor == 1.0


def test_an_aileron_that_moves_the_nose_on_its_own_is_an_input_too():
    """By the rudder alone the fit is poor; by both it is the plant"""
    found = told(flight(AILERON))

    assert found.found.inputs == list(BOTH)
    assert "b1_aileron" in found.found.estimates["rml"].theta
    assert_right(found)
    alone = told(flight(AILERON), given=("inputs",))
    assert alone.found.inputs == ["rudder"]
    by_both, by_one = (each.found.estimates["rml"].fit for each in (found, alone))
    assert by_both.simulation_pct > by_one.simulation_pct + 2.0


def test_an_aileron_that_brings_the_fit_nothing_is_not_an_input():
    y = yawing(RUDDER, 0.0, noise=NOISE)
    assert told(flight(AILERON, y=y)).found.inputs == ["rudder"]


def test_an_aileron_that_is_the_rudders_copy_is_not_an_input():
    samples = stream(RUDDER, y=yawing(RUDDER, 0.5 * RUDDER, noise=NOISE), aileron=0.5 * RUDDER)
    assert told(samples).found.inputs == ["rudder"]


def test_an_aileron_that_only_reacts_is_not_an_input():
    """A pilot or a damper that levels the wings: what yaw rate and roll explain moves nothing"""
    y = yawing(RUDDER, 0.0, noise=NOISE)
    for _ in range(20):  # the loop closed by iteration
        roll = lfilter([TS_S], [1.0, -0.98], 0.5 * y)
        reaction = np.concatenate([[0.0], -0.6 * roll[:-1] - 0.3 * y[:-1]])
        y = yawing(RUDDER, reaction, noise=NOISE)
    found = told(stream(RUDDER, y=y, aileron=reaction, roll=roll))

    assert np.ptp(reaction) > 0.1
    assert found.found.inputs == ["rudder"]


def test_in_a_mode_that_holds_roll_the_aileron_is_no_input():
    assert told(flight(AILERON, mode=FBWA)).found.inputs == ["rudder"]
    assert told(flight(AILERON, mode=MANUAL)).found.inputs == list(BOTH)
    assert told(flight(AILERON, mode=np.nan)).found.inputs == list(BOTH)


@pytest.mark.parametrize("mode", [MANUAL, FBWA])
def test_inputs_that_were_given_bind(mode: float):
    one = told(flight(AILERON, mode=mode), inputs=("rudder",), given=("inputs",))
    assert one.found.inputs == ["rudder"]
    u = np.column_stack([RUDDER, AILERON])
    both = told(replace(flight(AILERON, mode=mode), u=u), inputs=BOTH)
    assert both.found.inputs == list(BOTH)
    assert_right(both)


def rolling(seed: int) -> SampleBlock:
    """Strokes of the foot on a runway: a lag of .1 to .5 s without a Dutch roll, and its bumps"""
    rng = np.random.default_rng([7, seed])
    seconds, strength, noise, bumps_hz, lag_s = (
        rng.uniform(*span)
        for span in ((6.0, 14.0), (0.15, 0.4), (0.01, 0.12), (0.4, 2.0), (0.08, 0.5))
    )
    rng, n = np.random.default_rng(seed), round(seconds * HZ)
    rudder, at = np.zeros(n), HZ
    while at < n - 3 * HZ:
        width = rng.integers(6, 24)
        rudder[at : at + width] = strength * rng.choice([-1, 1]) * rng.uniform(0.5, 1)
        at += width + rng.integers(0, 30)
    decay = math.exp(-TS_S / lag_s)
    yaw = lfilter([0.0, 0.8 * (1.0 - decay)], [1.0, -decay], rudder)
    bumps = lfilter(*butter(2, bumps_hz / (HZ / 2)), rng.standard_normal(n + 100))[100:]
    return stream(rudder, y=yaw + noise * bumps / bumps.std(), airspeed=15.0)


@pytest.mark.parametrize("seed", [10, 31, 42, 145, 228, 241, 254, 274, 469])
def test_a_roll_on_a_runway_is_refused_where_a_richer_structure_moves_wn(
    seed: int,
):
    """Each was usable by all other rules, with a sigma of 3 to 10 %"""
    found = told(rolling(seed)).found

    fatal = next(each for each in found.verdict.fatal if each.id == "not_converged")
    share = float(
        re.search(r"a model with more parameters moves wn by about ([\d.]+) %", fatal.text)[1]
    )
    assert share > 10.0
    assert found.dutch_roll.wn_std >= 0.00999 * share * found.dutch_roll.wn_rad_s


@pytest.mark.parametrize(("last", "is_refused"), [(1.25, False), (1.4, True), (0.7, True)])
def test_an_airspeed_that_is_another_one_at_the_end_refuses_a_stretch_that_was_named(
    last: float, is_refused: bool
):
    """Which is never cut: wn goes with the airspeed"""
    speed = np.linspace(20.0, 20.0 * last, len(RUDDER))
    found = told(flight(airspeed=speed), from_s=0.0, to_s=40.0).found

    assert [reason.id for reason in found.verdict.fatal] == ["not_converged"] * is_refused
    assert not is_refused or "the first and the last airspeed differ" in found.verdict.fatal[0].text


def banked(strength: float) -> dict[str, Any]:
    turn = strength * np.sin(0.25 * np.arange(len(RUDDER)) * TS_S)
    return {"turn": turn, "y": yawing(RUDDER, noise=NOISE) + turn}


def test_the_turn_is_removed_where_the_bank_would_drown_the_rudder():
    found = told(flight(**banked(0.8)))

    assert found.found.turn_removed
    assert "turn_dominated" not in {reason.id for reason in found.verdict.reasons}
    assert_right(found)
    assert not told(flight(**banked(0.01))).found.turn_removed


def test_a_turn_that_was_given_binds():
    kept = told(flight(**banked(0.8)), turn="keep", given=("turn",))
    assert not kept.found.turn_removed
    assert "turn_dominated" in {reason.id for reason in kept.verdict.reasons}
    assert not told(flight(**banked(0.8)), band=(0.2, 3.0)).found.turn_removed


def test_a_turn_that_the_stream_removed_is_not_removed_again():
    """Its y has come without it"""
    found = told(flight(turn=banked(0.8)["turn"]), turn="remove")

    assert found.found.turn_removed
    assert_right(found)


def test_orders_that_were_given_bind():
    free = told(flight())
    assert set(free.structures) == {(3, 3, 2, 1), OTHER_ORDERS}
    for options in ({"orders": (2, 2, 2, 1)}, {"given": ("orders",)}):
        bound = told(flight(), **options)
        orders = options.get("orders", (3, 3, 2, 1))
        assert list(bound.structures) == [orders]
        assert str(bound.found.orders) == ",".join(map(str, orders))


def test_the_other_structure_tells_the_same_plant():
    other = told(flight()).structures[OTHER_ORDERS]

    assert other.dutch_roll[0] == pytest.approx(WN, rel=0.03)
    # A spare slow pole takes a part of the gain at rest.
    assert other.physics["K"][0] == pytest.approx(0.3, rel=0.2)


def test_each_structure_bears_its_own_distance_from_the_others():
    """Of wn and zeta, and of K, as a sigma: what a flight adds to noise and scatter"""
    found = told(flight())
    own, other = found.structures[(3, 3, 2, 1)], found.structures[OTHER_ORDERS]
    answer = found.found.estimates["oe"]

    for each in (own, other):
        assert each.beyond[0] >= 0.005 * each.dutch_roll[0]
        assert each.beyond[1] >= 0.005
    assert own.beyond != other.beyond
    assert answer.dutch_roll.wn_std_noise == own.dutch_roll[1]
    assert answer.dutch_roll.wn_std >= math.hypot(own.dutch_roll[1], own.beyond[0]) * (1.0 - 1e-12)
    value, of_noise, beyond = own.physics["K"]
    assert (value, of_noise) == (answer.physics["K"].value, answer.physics["K"].std_noise)
    assert answer.physics["K"].std >= math.hypot(of_noise, beyond) * (1.0 - 1e-12)


def test_els_answers_where_it_is_asked_for_alone():
    alone = told(flight(), method="els", also="none").found
    assert list(alone.estimates) == ["els"]
    assert alone.verdict.method == "els"
    assert alone.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.05)
    for options in ({"method": "els"}, {"method": "rml", "also": "none"}, {"method": "rml"}):
        found = told(flight(), **options).found
        assert found.verdict.method == "oe"
        assert "rml" in found.estimates


def test_a_further_method_of_a_record_is_its_fit_and_its_row(monkeypatch: pytest.MonkeyPatch):
    # Hannan and Rissanen's two regressions alone, as a method that the other two check.
    row = replace(
        METHODS["rml"],
        name="hr",
        fit=lambda record, settled: record.first_guess,
        checked_by=("rml", "els"),
    )
    monkeypatch.setitem(METHODS, "hr", row)

    found = told(flight()).found

    assert list(found.estimates) == ["hr", "rml", "els"]
    assert found.verdict.method == "hr"
    assert found.dutch_roll.wn_rad_s == pytest.approx(WN, rel=0.05)
    own, rml = (found.estimates[name].theta for name in ("hr", "rml"))
    assert own.keys() == rml.keys()
    assert own != rml


@pytest.mark.parametrize(("mode", "has_level"), [(MANUAL, True), (FBWA, False), (np.nan, False)])
def test_a_level_of_flying_qualities_is_the_airframes_alone(mode: float, has_level: bool):
    found = told(flight(mode=mode)).found
    for each in found.estimates.values():
        assert (each.dutch_roll.level is not None) == has_level


def test_a_roll_loop_makes_zeta_less_sure_where_the_aileron_is_no_input():
    closed, bare = (told(flight(mode=mode)).found.dutch_roll for mode in (FBWA, MANUAL))
    both = told(flight(AILERON, mode=np.nan)).found

    added = (0.04 * closed.zeta) ** 2 - 0.005**2  # in place of the least sigma that all have
    assert closed.zeta_std == pytest.approx(math.sqrt(bare.zeta_std**2 + added), rel=1e-6)
    assert closed.wn_std == bare.wn_std
    assert both.inputs == list(BOTH)
    assert both.dutch_roll.zeta_std < 0.04 * both.dutch_roll.zeta


def held_back_pct(found: Answered) -> float | None:
    return found.found.estimates[found.verdict.method].fit.simulation_held_back_pct


@pytest.mark.parametrize(("strong", "seconds"), [(0.1, 12.0), (0.2, 3.0)])
def test_what_is_held_back_is_the_last_third_of_the_rudders_energy(strong: float, seconds: float):
    """Where only that is turned round the model fitted without it tells the opposite"""
    rudder = flown(rest(30), prbs(24.0, 0.1, 1), prbs(seconds, strong, 2))
    y = yawing(rudder, noise=NOISE)
    assert held_back_pct(told(stream(rudder, y=y))) > 90.0
    y[54 * HZ :] *= -1.0
    found = told(stream(rudder, y=y))
    assert held_back_pct(found) < -80.0
    assert found.found.estimates["els"].fit.simulation_held_back_pct is None


def test_nothing_is_held_back_where_too_little_would_be_left_to_fit_by():
    """Ten samples for each of nine parameters; two thirds of the energy come in 2/3 of 145 rows"""
    for seconds, is_there in ((6.0, False), (8.0, True)):
        rudder = prbs(seconds, 0.2, 3)
        found = told(stream(rudder, y=yawing(rudder, noise=NOISE)))
        assert (held_back_pct(found) is not None) == is_there


@pytest.mark.parametrize("rows", [1, 5, 18])
def test_a_stretch_that_is_too_short_is_refused_with_a_reason(rows: int):
    rudder = doublets(30.0)[:rows]
    found = told(stream(rudder, y=yawing(rudder, noise=NOISE)))

    assert not found.verdict.usable
    assert found.found.dutch_roll is None


@pytest.mark.parametrize("what", ["all held", "rudder at rest", "no response"])
def test_what_tells_nothing_is_refused(what: str):
    rudder = {"all held": np.full(400, np.nan), "rudder at rest": rest(20, 0.3)}.get(what, RUDDER)
    y = NOISE * np.random.default_rng(2).normal(size=len(rudder))
    found = told(stream(rudder, y=y))

    assert not found.verdict.usable


def test_held_samples_inside_are_no_samples():
    samples = flight()
    gone = slice(200, 230)
    u, y, held = samples.u.copy(), samples.y.copy(), samples.held.copy()
    u[gone], y[gone], held[gone] = np.nan, np.nan, 1
    assert_right(told(replace(samples, u=u, y=y, held=held)))


def test_the_samples_are_not_changed():
    samples = flight(AILERON, **banked(0.8))
    kept = {name: np.copy(getattr(samples, name)) for name in ("u", "y", "aileron", "turn_rate")}
    told(samples)
    for name, before in kept.items():
        np.testing.assert_array_equal(getattr(samples, name), before)


def test_inputs_given_on_the_command_line_bind(capsys, monkeypatch, tmp_path):
    """--inputs rudder is the default, and still an order: RunConfig.given holds that it was said"""
    seen = []

    def noted(samples: SampleBlock, n: int, setting: ManoeuvreSetting) -> Answered:
        seen.append(setting.config)
        return answer(samples, n, setting)

    monkeypatch.setattr("yawid.manoeuvres.stage.answer", noted)
    usual = ["replay", str(C172P), "--rerun", "off", "--json", "--out"]
    for options in ([], ["--inputs", "rudder"], ["--turn", "keep", "--orders", "3,3,2,1"]):
        main([*usual, str(tmp_path / "".join(options)), *options])
        (line,) = capsys.readouterr().out.splitlines()
        assert json.loads(line)["manoeuvres"]
        given = {option.removeprefix("--") for option in options[::2]}
        assert {name for name in ("inputs", "turn", "orders") if seen[-1].binds(name)} == given
