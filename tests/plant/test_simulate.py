"""Excitations, and the plants that they fly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yawid.errors import ConfigError
from yawid.plant.excitation import KINDS, Excitation
from yawid.plant.simulate import PLANTS, simulate_plant

TS = 0.1


@given(st.sampled_from(KINDS), st.floats(0.01, 5.0), st.floats(0.0, 20.0), st.integers(0, 99))
def test_every_kind_is_zero_before_its_start_and_peaks_at_its_amplitude(kind, size, start, seed):
    excitation = Excitation(kind=kind, amplitude=size, start_s=start, seed=seed)
    u = excitation.samples(500, TS)
    first = round(start / TS)
    peak = size / TS if kind == "impulse" else size
    assert u.shape == (500,)
    assert not u[:first].any()
    assert np.abs(u).max() == pytest.approx(peak, rel=0.03)
    np.testing.assert_array_equal(u, excitation.samples(500, TS))


def test_step_impulse_doublet_and_3211_are_what_their_names_say():
    def shape(kind):
        return Excitation(kind=kind, amplitude=2.0, start_s=0.2, unit_s=0.2).samples(18, TS)

    np.testing.assert_array_equal(shape("step"), [0] * 2 + [2] * 16)
    np.testing.assert_array_equal(shape("impulse"), [0] * 2 + [20] + [0] * 15)
    np.testing.assert_array_equal(shape("doublet"), [0] * 2 + [2] * 2 + [-2] * 2 + [0] * 12)
    np.testing.assert_array_equal(
        shape("3211"), [0] * 2 + [2] * 6 + [-2] * 4 + [2] * 2 + [-2] * 2 + [0] * 2
    )


def test_a_prbs_is_flat_holds_its_bits_and_never_stands_still():
    bits = Excitation(kind="prbs", unit_s=TS, seed=4).samples(1023, TS)
    autocorrelation = [np.mean(bits * np.roll(bits, lag)) for lag in range(1, 1023)]
    held = [Excitation(kind="prbs", unit_s=1.0, seed=seed).samples(160, TS) for seed in range(200)]

    np.testing.assert_allclose(autocorrelation, -1.0 / 1023, atol=1e-12)
    np.testing.assert_array_equal(np.repeat([each[::10] for each in held], 10, axis=1), held)
    assert {tuple(sorted(set(each))) for each in [bits, *held]} == {(-1.0, 1.0)}
    assert len(set(map(tuple, held))) > 10


def test_sweep_and_multisine_have_their_power_in_the_band():
    for kind in ("sweep", "multisine"):
        u = Excitation(kind=kind, low_hz=0.2, high_hz=1.0).samples(4000, TS)
        power = np.abs(np.fft.rfft(u)) ** 2
        f = np.fft.rfftfreq(4000, TS)
        assert power[(f >= 0.19) & (f <= 1.01)].sum() > 0.97 * power.sum()


def test_a_sweep_begins_low_and_ends_high():
    u = Excitation(kind="sweep", low_hz=0.1, high_hz=2.0).samples(2000, 0.05)
    crossings = np.flatnonzero(np.diff(np.sign(u)))
    half = np.diff(crossings, prepend=0) * 0.05
    assert half[0] == pytest.approx(5.0, rel=0.2)
    assert half[-1] == pytest.approx(0.25, rel=0.25)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"kind": "noise"}, "must be one of step"),
        ({"kind": "step", "amplitude": 0.0}, "amplitude"),
        ({"kind": "step", "amplitude": np.nan}, "amplitude"),
        ({"kind": "step", "start_s": -1.0}, "start_s"),
        ({"kind": "3211", "unit_s": 0.0}, "unit_s"),
        ({"kind": "prbs", "seed": -1}, "seed"),
        ({"kind": "step", "start_s": 60.0}, "outside the 500 samples"),
        ({"kind": "doublet", "unit_s": 0.01}, "shorter than half a sample"),
        ({"kind": "sweep", "high_hz": 6.0}, "half the rate"),
        ({"kind": "multisine", "low_hz": 0.501, "high_hz": 0.502}, "no harmonic"),
    ],
)
def test_a_setting_outside_its_limits_or_that_does_not_fit_the_samples_is_named(settings, text):
    with pytest.raises(ConfigError, match=text):
        Excitation(**settings).samples(500, TS)


PULSES = Excitation(kind="3211", amplitude=1e-4, start_s=1.0)
BOTH = ("rigid-body", "lateral")


@pytest.mark.parametrize("name", PLANTS)
def test_right_rudder_turns_the_nose_right(name):
    flown = simulate_plant(name, Excitation(kind="step", amplitude=0.05), duration_s=1.2)
    assert (flown.u == 0.05).all()
    assert (flown.y[1:] > 0.0).all()
    assert (np.diff(flown.yaw) > 0.0).all()
    assert flown.roll[-1] > 0.0 or name == "yaw"


@pytest.mark.parametrize(("amplitude", "least", "most"), [(1e-4, 0.0, 1e-3), (0.3, 0.02, 1.0)])
def test_a_small_rudder_flies_the_rigid_body_as_eq_21_says_and_a_large_one_does_not(
    amplitude, least, most
):
    moves = Excitation(kind="3211", amplitude=amplitude, start_s=1.0)
    body, linear = (simulate_plant(name, moves, duration_s=20.0) for name in BOTH)
    for field in ("y", "yaw", "roll"):
        one, other = getattr(body, field), getattr(linear, field)
        assert least < np.abs(one - other).max() / np.abs(other).max() < most


def test_noise_is_white_of_its_size_and_comes_back_with_its_seed():
    quiet = simulate_plant("yaw", PULSES)
    noisy, again, other = (simulate_plant("yaw", PULSES, noise_std=0.01, seed=s) for s in (1, 1, 2))
    noise = noisy.y - quiet.y
    assert np.std(noise) == pytest.approx(0.01, rel=0.08)
    np.testing.assert_array_equal(noisy.y, again.y)
    assert (noisy.y != other.y).any()
    np.testing.assert_array_equal(noisy.yaw, quiet.yaw)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"name": "kite"}, "plant must be one of yaw"),
        ({"sample_time_s": 0.0}, "sample time"),
        ({"duration_s": np.inf}, "duration"),
        ({"noise_std": -1.0}, "noise_std"),
        ({"name": "rigid-body", "excitation": Excitation(kind="step", amplitude=3.0)}, "forward"),
    ],
)
def test_what_cannot_be_flown_is_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        simulate_plant(**({"name": "yaw", "excitation": PULSES} | settings))
