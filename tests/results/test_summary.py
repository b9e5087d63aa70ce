"""The fit on held-back data: a model is asked about samples it had not seen."""

from __future__ import annotations

from dataclasses import asdict
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete, lfilter

from yawid.blocks import SampleBlock
from yawid.config.run import RunConfig
from yawid.estimation.armax import RecursiveArmax
from yawid.estimation.bank import REMEMBERED, Bank
from yawid.estimation.fit import fit_percent, simulate
from yawid.results.judge_estimate import Evidence, estimate_reasons
from yawid.results.structures import NOTHING_KNOWN
from yawid.results.summary import bank_summaries, stream_spread

TS = 0.1
KEEPS_ALL = RunConfig(forgetting=1.0)


def flown(n: int, wn: float = 2.4, seed: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Rudder and yaw rate of eq. 23 (zeta 0.25, T 0.8 s) with one percent of noise."""
    b, a, _ = cont2discrete((wn**2 * np.array([0.8, 1.0]), [1.0, 0.5 * wn, wn**2]), TS)
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-0.2, 0.2], n // 5 + 1), 5)[:n]
    y = lfilter(np.ravel(b), a, u)
    return u, y + 0.01 * y.std() * rng.standard_normal(n)


def samples(u: np.ndarray, y: np.ndarray) -> SampleBlock:
    k, zero = np.arange(len(y)), np.zeros(len(y))
    stamp = (k * TS * 1e6).astype(np.int64)
    columns = [k, stamp, 1000 * stamp, stamp, u[:, None], y, *[zero] * 4, *[np.zeros_like(k)] * 3]
    columns += [np.full(len(y), np.nan)] * 7
    return SampleBlock(TS, *columns)


def bank_of(u: np.ndarray, y: np.ndarray, config: RunConfig, cuts: list[int] = ()) -> Bank:
    whole, bank = samples(u, y), Bank(config, TS)
    for first, last in pairwise(sorted({0, *cuts, len(y)})):
        bank.run(whole.select(slice(first, last)))
    return bank


def evidence_of(bank: Bank, method: str = "els") -> Evidence:
    return bank_summaries(bank)[1][method]


def held_back_pct(bank: Bank, method: str = "els") -> float | None:
    return bank_summaries(bank)[0][method].fit.simulation_held_back_pct


@pytest.mark.parametrize("method", ["els", "rml"])
def test_it_is_the_model_at_two_thirds_run_free_over_the_rest(method):
    u, y = flown(900)
    y[100:110] = np.nan

    found = held_back_pct(bank_of(u, y, KEEPS_ALL), method)

    split = 10 + int(2 / 3 * 890) // REMEMBERED * REMEMBERED
    split -= split % REMEMBERED
    armax = RecursiveArmax(KEEPS_ALL.estimator(method, TS))
    armax.run(u[:split], y[:split])
    simulated = simulate(armax.theta, armax.config.orders, True, u[split:, None], y[split:])
    assert found == pytest.approx(fit_percent(y[split:], simulated), abs=1e-9)
    assert 90.0 < found < 100.0


def test_what_comes_after_does_not_change_the_model_it_is_tried_on():
    u, y = flown(900)
    other = y.copy()
    other[620:] = np.random.default_rng(7).standard_normal(280)

    one, two = (bank_of(u, values, KEEPS_ALL).earlier(600) for values in (y, other))

    assert one is not None
    assert two is not None
    assert one.first == two.first <= 600
    np.testing.assert_array_equal(one.theta["els"], two.theta["els"])
    assert held_back_pct(bank_of(u, other, KEEPS_ALL)) < 20.0


@given(cuts=st.lists(st.integers(1, 699), max_size=8), memory=st.sampled_from([None, 15.0]))
@settings(max_examples=10, deadline=None)
def test_it_does_not_depend_on_how_the_stream_was_cut(cuts, memory):
    u, y = flown(700)
    config = RunConfig(memory=memory)

    whole, parts = (bank_summaries(bank_of(u, y, config, each)) for each in ([], cuts))

    assert whole[0] == parts[0]
    for method in ("els", "rml"):
        one, other = (asdict(found[1][method]) for found in (whole, parts))
        for name, value in one.items():
            np.testing.assert_array_equal(value, other[name], err_msg=name)


def test_where_there_is_too_little_to_hold_back_there_is_no_such_figure():
    assert held_back_pct(bank_of(*flown(150), KEEPS_ALL)) is None
    assert held_back_pct(bank_of(*flown(300), KEEPS_ALL)) is not None


def test_where_the_rudder_rests_in_the_last_third_there_is_nothing_to_try_the_model_on():
    """The yaw rate there is noise, of which no model tells anything; it was -1000 % and refused."""
    u, y = flown(900)
    u[500:] = 0.0
    y[560:] = 1e-3 * np.random.default_rng(3).standard_normal(340)

    assert held_back_pct(bank_of(u, y, KEEPS_ALL)) is None
    u[850:870] = 0.2
    assert held_back_pct(bank_of(u, y, KEEPS_ALL)) is not None


def test_a_summary_has_the_total_sigma_and_beside_it_that_of_noise():
    """The total is what the structures and the record's parts make of it, of every number"""
    bank = bank_of(*flown(600), KEEPS_ALL)
    summaries, evidence = bank_summaries(bank)
    spread = stream_spread(bank, bank.history())

    for method, found in summaries.items():
        roll, judged = found.dutch_roll, evidence[method]
        noise = (roll.wn_std_noise, roll.zeta_std_noise)
        assert tuple(judged.dutch_roll[1::2]) == noise
        assert tuple(judged.total_std) == (roll.wn_std, roll.zeta_std)
        told = {"wn_rad_s": (roll.wn_rad_s, *noise[:1], roll.wn_std)}
        told |= {"zeta": (roll.zeta, *noise[1:], roll.zeta_std)}
        assert found.physics["reduction_error"].std_noise is None
        numbers = {n: v for n, v in found.physics.items() if n != "reduction_error"}
        told |= {n: (v.value, v.std_noise, v.std) for n, v in numbers.items()}
        around = spread.around(roll.wn_rad_s)
        for name, (value, of_noise, std) in told.items():
            assert std == around.total(method, name, value, of_noise), name
            assert std >= of_noise, name
            assert std > of_noise or method == "els", name


def test_a_stream_is_compared_with_the_newest_two_memories():
    """What lay before is another aircraft's: it would make the spread that of a change"""
    (u, before), (_, after) = flown(1400, wn=1.5), flown(1400, wn=2.4)
    y = np.concatenate([before[:990], after[990:]])
    config = RunConfig(memory=20.0)  # 201 samples; the aircraft changed 410 ago
    known, other = (bank_of(u, each, config) for each in (y, after))

    spreads = [stream_spread(bank, bank.history()) for bank in (known, other)]
    for spread in spreads:
        (own,) = (e for e in spread.opinions if e.orders == config.orders and e.every == 1)
        assert own.dutch_roll[0] == pytest.approx(2.4, rel=0.02)
    told, expected = ([each.dutch_roll.tolist() for each in spread.opinions] for spread in spreads)
    assert told == expected


def test_a_bank_without_a_dutch_roll_knows_nothing_beside_it():
    bank = bank_of(np.zeros(300), np.zeros(300), KEEPS_ALL)
    assert stream_spread(bank, bank.history()) == NOTHING_KNOWN
    assert np.isnan(evidence_of(bank).total_std).all()


def test_a_model_that_forgets_is_tried_on_the_last_of_what_it_remembers():
    """Three memories are kept, 600 samples: what lay before the change of plant is forgotten."""
    (u, before), (_, after) = flown(2000, wn=1.5), flown(2000, wn=2.4)
    y = np.concatenate([before[:1000], after[1000:]])

    bank = bank_of(u, y, RunConfig(memory=20.0))

    assert held_back_pct(bank) > 90.0
    earlier = bank.earlier(400)
    assert earlier is not None
    assert 384 < earlier.first <= 400


def test_a_long_session_keeps_no_more_models_than_a_short_one():
    u, y = flown(20_000)
    config = RunConfig(memory=5.0, also="none")
    whole, bank, kept = samples(u, y), Bank(config, TS), []
    for first in range(0, len(y), 10):
        bank.run(whole.select(slice(first, first + 10)))
        kept.append(sum(ring.nbytes for ring in bank._thetas._rings))

    assert max(kept[1000:]) == max(kept[:1000])


def test_an_estimate_that_still_moves_is_not_converged():
    u, y = flown(1200)
    moving = y.copy()
    moving[1000:] = flown(1200, wn=3.4)[1][1000:]

    def reasons(values: np.ndarray) -> set[str]:
        evidence = evidence_of(bank_of(u, values, RunConfig()))
        return {reason.id for reason in estimate_reasons("els", evidence)}

    assert "not_converged" not in reasons(y)
    assert "not_converged" in reasons(moving)
