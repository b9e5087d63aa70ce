"""A fit over a whole record: RML's is the prediction-error fit, ELS's its own fixed point."""

import numpy as np
import pytest
from estimation.armax_plants import S1, S2, S3, Floats, Plant, config, simulate, truth
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, root
from scipy.signal import cont2discrete, lfilter

from yawid import ArmaxOrders, EstimatorConfig, RecursiveArmax, Status
from yawid.estimation.polynomials import c_of, lag_depth, spr_margin
from yawid.estimation.record_fit import FittedModel, fit_record
from yawid.physics.modes import modes

PLANTS = pytest.mark.parametrize("plant", [S1, S2, S3], ids=["S1", "S2", "S3"])
METHODS = pytest.mark.parametrize("method", ["els", "rml"])


def made(plant: Plant, method: str, **options: object) -> EstimatorConfig:
    orders = ArmaxOrders(len(plant[0]), len(plant[1]), len(plant[2]), 1)
    return config(orders, method=method, bias=False, **options)


def fitted(plant: Plant, method: str, u: Floats, y: Floats) -> FittedModel:
    return fit_record(made(plant, method), u[:, None], y)


def residuals(config: EstimatorConfig, theta: Floats, u: Floats, y: Floats) -> Floats:
    """C eps = A y - B u from the first sample with all its lags on, by scipy and no code of ours"""
    orders = config.orders
    a, b, c = np.split(theta, [orders.na, orders.na + orders.nb[0]])
    drive = lfilter((1.0, *a), 1.0, y) - lfilter((0.0, *b), 1.0, u)
    return lfilter([1.0], (1.0, *c), drive[lag_depth(orders) :])


def regressors(config: EstimatorConfig, theta: Floats, u: Floats, y: Floats) -> Floats:
    orders, depth = config.orders, lag_depth(config.orders)
    eps = np.concatenate([np.zeros(depth), residuals(config, theta, u, y)])
    rows = range(depth, len(y))
    counts = ((-y, orders.na), (u, orders.nb[0]), (eps, orders.nc))
    columns = [[x[k - i - 1] if k > i else 0.0 for k in rows] for x, n in counts for i in range(n)]
    return np.array(columns).T


def sigma(model: FittedModel) -> Floats:
    return np.sqrt(np.diag(model.covariance))


@PLANTS
def test_rml_is_the_start_fit_of_a_recursion_that_buffers_all_of_the_record(plant: Plant):
    u, y = simulate(plant, 800, 1)
    recursion = RecursiveArmax(made(plant, "rml", start_buffer=800))
    recursion.run(u, y, keep="last")

    np.testing.assert_allclose(fitted(plant, "rml", u, y).theta, recursion.theta, rtol=1e-6)


@PLANTS
def test_rml_has_the_least_sum_of_squares_that_scipy_finds(plant: Plant):
    u, y = simulate(plant, 800, 2)
    found, made_for = fitted(plant, "rml", u, y), made(plant, "rml")
    scipy = least_squares(lambda theta: residuals(made_for, theta, u, y), truth(plant), xtol=1e-14)

    assert np.max(np.abs(found.theta - scipy.x) / sigma(found)) < 1e-2
    eps = residuals(made_for, found.theta, u, y)
    assert found.innovation_std == pytest.approx(np.sqrt(np.mean(eps**2)), rel=1e-9)
    assert found.residual_std == found.innovation_std


@PLANTS
def test_els_rests_where_scipy_finds_the_root_of_its_own_equations(plant: Plant):
    u, y = simulate(plant, 800, 3)
    found, made_for = fitted(plant, "els", u, y), made(plant, "els")

    def balance(theta: Floats) -> Floats:
        return regressors(made_for, theta, u, y).T @ residuals(made_for, theta, u, y)

    phi, eps = (f(made_for, found.theta, u, y) for f in (regressors, residuals))
    scores = np.sqrt(np.mean(eps**2) * (phi**2).sum(axis=0))
    assert np.max(np.abs(balance(found.theta)) / scores) < 1e-3
    scipy = root(balance, truth(plant), tol=1e-12)
    assert scipy.success
    assert np.max(np.abs(found.theta - scipy.x) / sigma(found)) < 1e-3


def passes(plant: Plant, begin: Floats, u: Floats, y: Floats, count: int) -> Floats:
    """Extended least squares over the record, again and again: eps of the model before in phi"""
    theta, made_for = begin, made(plant, "els")
    for _ in range(count):
        phi = regressors(made_for, theta, u, y)
        theta = np.linalg.lstsq(phi, y[lag_depth(made_for.orders) :], rcond=None)[0]
    return theta


def test_els_is_what_many_passes_come_to_where_they_settle():
    u, y = simulate(S3, 600, 4)
    found = fitted(S3, "els", u, y)

    many = passes(S3, np.zeros(6), u, y, 40)
    assert np.max(np.abs(found.theta - many) / sigma(found)) < 1e-3


def test_els_is_found_where_passes_run_away_from_it():
    """C(q) of S2 is not positive real: a pass makes what misses the fixed point larger (Ljung)"""
    u, y = simulate(S2, 600, 5)
    found = fitted(S2, "els", u, y)

    assert spr_margin(c_of(found.theta, found.config.orders)) < 0.0
    beside = found.theta + 1e-3 * sigma(found)
    with np.errstate(all="ignore"):
        away = passes(S2, beside, u, y, 12)
    assert np.max(np.abs(away - found.theta) / sigma(found)) > 0.1


def apart(plant: Plant, seed: int) -> float:
    """By how many of RML's sigmas the two methods differ at most"""
    u, y = simulate(plant, 800, seed)
    rml, els = (fitted(plant, method, u, y) for method in ("rml", "els"))
    return float(np.max(np.abs(rml.theta - els.theta) / sigma(rml)))


def test_els_does_not_share_the_answer_of_rml():
    """It is a check only where it can differ: on S3 the two agree, on S2 they need not"""
    assert np.median([apart(S2, seed) for seed in range(20)]) > 1.0
    assert np.median([apart(S3, seed) for seed in range(20)]) < 1.0
    for seed in range(3):
        u, y = simulate(S2, 800, seed)
        rml, els = (fitted(S2, method, u, y) for method in ("rml", "els"))
        difference = np.abs(rml.theta - els.theta)
        assert np.all(difference < 4.0 * np.hypot(sigma(rml), sigma(els)))


@METHODS
@PLANTS
def test_sigma_covers_the_truth(plant: Plant, method: str):
    missed = []
    for seed in range(100):
        u, y = simulate(plant, 500, seed)
        model = fitted(plant, method, u, y)
        missed.append((model.theta - truth(plant)) / sigma(model))
    scatter = np.sqrt(np.mean(np.square(missed), axis=0))
    assert scatter.min() > 0.8
    assert scatter.max() < 1.25


def test_sigma_covers_the_limit_where_the_residuals_are_coloured():
    """Of a model too small for its plant: no truth, but a limit, about which the fits scatter"""
    small = config(ArmaxOrders(0, 1, 0, 1), method="rml", bias=False)
    models, white = [], []
    for seed in range(150):
        u, e = lfilter([1.0], [1.0, -0.9], np.random.default_rng(seed).standard_normal((2, 500)))
        models.append(fit_record(small, u[:, None], lfilter((0.0, 1.0), 1.0, u) + e))
        white.append(models[-1].innovation_std / np.sqrt(u @ u))
    scatter = np.std([model.theta for model in models])
    told = np.sqrt(np.mean([model.covariance for model in models]))

    assert scatter > 2.0 * np.mean(white)
    assert scatter == pytest.approx(told, rel=0.25)


@METHODS
@PLANTS
def test_the_parts_of_a_record_scatter_on_the_mean_as_noise_lets_them(plant: Plant, method: str):
    """Eight blocks of one record tell it roughly, those of forty records well"""
    models = [fitted(plant, method, *simulate(plant, 500, seed)) for seed in range(40)]
    variances = [np.diag(np.mean([m.scatter for m in models], axis=0))]
    variances.append(np.diag(np.mean([m.covariance for m in models], axis=0)))

    ratio = np.sqrt(variances[0] / variances[1])
    assert ratio.min() > 0.8
    assert ratio.max() < 1.2


def yawing(wn: float, seed: int) -> tuple[Floats, Floats]:
    """A Dutch roll of this wn at 20 Hz, moved by pulses of .3 s, 40 s long"""
    b, a, _ = cont2discrete((0.3 * wn**2 * np.array([0.3, 1.0]), [1.0, 0.6 * wn, wn**2]), 0.05)
    rng = np.random.default_rng(seed)
    u = 0.2 * np.repeat(rng.choice([-1.0, 1.0], 134), 6)[:800]
    coloured = lfilter([1.0, -0.5], [1.0, -1.5, 0.7], rng.standard_normal(800))
    return u, lfilter(b[0], a, u) + 0.003 * coloured


@METHODS
def test_the_parts_of_a_record_scatter_more_than_noise_where_the_aircraft_changed(method: str):
    """wn 6, then 6.6: what lasts half the record is beyond the lags that noise is summed over"""
    for_ever, changed = [], []
    for seed in range(8):
        (u, y), (_, other) = yawing(6.0, seed), yawing(6.6, seed)
        halves = np.concatenate([y[:400], other[400:]])
        for ratios, output in ((for_ever, y), (changed, halves)):
            model = fit_record(config(ArmaxOrders(3, 3, 2, 1), method=method), u[:, None], output)
            noise, scatter = (
                modes(model.row(each), model.config.orders, 0.05).dutch_roll[-1, 1]
                for each in (model.covariance, model.scatter)
            )
            ratios.append(scatter / noise)

    assert min(changed) > 1.4
    assert min(changed) > max(for_ever)


@METHODS
def test_a_record_without_noise_gives_the_truth(method: str):
    u, y = simulate(S1, 300, 17, noise=0.0)
    model = fitted(S1, method, u, y)

    np.testing.assert_allclose(model.theta[:4], truth(S1)[:4], rtol=1e-8)


@METHODS
def test_without_a_noise_model_both_are_least_squares(method: str):
    u, y = simulate(S1, 300, 18)
    model = fit_record(config(ArmaxOrders(2, 2, 0, 1), method=method, bias=False), u[:, None], y)

    phi = regressors(model.config, model.theta, u, y)
    np.testing.assert_allclose(model.theta, np.linalg.lstsq(phi, y[2:], rcond=None)[0], rtol=1e-6)


@METHODS
@settings(deadline=None, max_examples=20)
@given(
    of_u=st.floats(-9.0, 9.0).map(lambda e: 10.0**e),
    of_y=st.floats(-9.0, 9.0).map(lambda e: 10.0**e),
)
def test_units_change_nothing_but_the_units(method: str, of_u: float, of_y: float):
    u, y = simulate(S1, 300, 6)
    units = np.array([1.0, 1.0, of_y / of_u, of_y / of_u, 1.0, 1.0, of_y])
    setting = config(method=method)
    one, other = (
        fit_record(setting, u[:, None], y),
        fit_record(setting, of_u * u[:, None], of_y * y),
    )

    miss = np.abs(other.theta / units - one.theta) / sigma(one)
    assert miss.max() < 1e-3
    np.testing.assert_allclose(sigma(other) / units, sigma(one), rtol=1e-3)
    scatter = (np.sqrt(np.diag(model.scatter)) for model in (one, other))
    np.testing.assert_allclose(next(scatter), next(scatter) / units, rtol=1e-3)
    np.testing.assert_allclose(other.y_hat / of_y, one.y_hat, atol=1e-3)
    assert other.innovation_std / of_y == pytest.approx(one.innovation_std, rel=1e-4)
    assert other.whiteness_p == pytest.approx(one.whiteness_p, abs=1e-3)


@METHODS
@pytest.mark.parametrize("channel", ["u", "y"])
def test_what_is_missing_breaks_the_record(method: str, channel: str):
    """What lies on either side is fitted as two records: what is between never comes into phi"""
    u, y = simulate(S1, 600, 7)
    gone = slice(250, 260)
    held_u, held_y = u.copy(), y.copy()
    (held_u if channel == "u" else held_y)[gone] = np.nan
    spoilt_u, spoilt_y = u.copy(), y.copy()
    spoilt_u[gone] = spoilt_y[gone] = np.nan
    model = fit_record(made(S1, method), held_u[:, None], held_y)
    other = fit_record(made(S1, method), spoilt_u[:, None], spoilt_y)

    depth = lag_depth(model.config.orders)
    np.testing.assert_array_equal(model.theta, other.theta)
    assert (model.updates, model.held) == (590 - 2 * depth, 10 + 2 * depth)
    parts = [(u[:250], y[:250]), (u[260:], y[260:])]
    eps = np.concatenate([residuals(model.config, model.theta, *part) for part in parts])
    missed = np.abs(y - model.y_hat)
    np.testing.assert_allclose(missed[np.isfinite(missed)], np.abs(eps), atol=1e-9)
    assert not np.isfinite(missed[248:262]).all()
    assert np.isnan(missed[250 : 260 + depth]).all()
    assert np.isfinite(missed[depth:250]).all()
    assert np.isfinite(missed[260 + depth :]).all()


@METHODS
def test_two_records_are_fitted_together_as_their_sums(method: str):
    """Each alone says something else; what is said together lies where phi' eps of both add to 0"""
    one, other = simulate(S1, 300, 8), simulate(S1, 300, 9)
    gap = np.full(1, np.nan)
    u, y = (np.concatenate([a, gap, b]) for a, b in zip(one, other, strict=True))
    found = fit_record(made(S1, method), u[:, None], y)

    if method == "rml":

        def both(theta: Floats) -> Floats:
            return np.concatenate([residuals(found.config, theta, *part) for part in (one, other)])

        scipy = least_squares(both, truth(S1), xtol=1e-14).x
    else:

        def balance(theta: Floats) -> Floats:
            scores = [
                regressors(found.config, theta, *part).T @ residuals(found.config, theta, *part)
                for part in (one, other)
            ]
            return scores[0] + scores[1]

        scipy = root(balance, truth(S1), tol=1e-12).x
    assert np.max(np.abs(found.theta - scipy) / sigma(found)) < 1e-2


def test_white_residuals_are_told_from_coloured_ones():
    u, y = simulate(S1, 2000, 10)
    small = config(ArmaxOrders(1, 1, 1, 1), method="rml")

    assert fitted(S1, "rml", u, y).whiteness_p > 0.01
    assert fit_record(small, u[:, None], y).whiteness_p < 1e-6


@METHODS
def test_what_is_handed_in_is_not_changed(method: str):
    u, y = simulate(S1, 300, 11)
    u[50], y[70] = np.nan, np.inf
    kept = u.copy(), y.copy()
    fit_record(config(method=method), u[:, None], y)

    np.testing.assert_array_equal(u, kept[0])
    np.testing.assert_array_equal(y, kept[1])


@METHODS
def test_it_says_what_an_estimator_says_after_its_last_sample(method: str):
    u, y = simulate(S1, 300, 12)
    model = fit_record(config(method=method), u[:, None], y)

    last = model.last
    np.testing.assert_array_equal(last.theta[0], model.theta)
    np.testing.assert_array_equal(last.theta_std[0], sigma(model))
    np.testing.assert_array_equal(last.covariance[0], model.covariance)
    wider = model.row(4.0 * model.covariance)
    np.testing.assert_array_equal(wider.theta[0], model.theta)
    np.testing.assert_allclose(wider.theta_std[0], 2.0 * sigma(model))
    assert last.noise_std[0] == model.innovation_std
    assert last.status[0] == Status.TRACKING


@METHODS
@pytest.mark.parametrize("count", [0, 1, 5, 14])
def test_too_few_samples_are_no_fit(method: str, count: int):
    u, y = simulate(S1, 20, 13)
    assert_nothing(fit_record(config(method=method), u[:count, None], y[:count]), 0)


@METHODS
@pytest.mark.parametrize("value", [0.0, 0.3, 1e300])
@pytest.mark.parametrize("still", ["u", "y", "both"])
def test_a_channel_that_stands_still_is_no_fit(method: str, value: float, still: str):
    u, y = simulate(S1, 300, 14)
    if still != "y":
        u[:] = value
    if still != "u":
        y[:] = value
    assert_nothing(fit_record(config(method=method), u[:, None], y), 0)


@METHODS
def test_a_record_of_nothing_but_missing_samples_is_no_fit(method: str):
    nothing = np.full(300, np.nan)
    assert_nothing(fit_record(config(method=method), nothing[:, None], nothing), 0)
    u, y = simulate(S1, 300, 15)
    u[::3] = np.nan
    assert_nothing(fit_record(config(method=method), u[:, None], y), 0)


def assert_nothing(model: FittedModel, updates: int) -> None:
    assert model.updates == updates
    assert model.held == len(model.y_hat) - updates
    assert not model.theta.any()
    assert np.isnan(model.y_hat).all()
    assert np.isnan(model.covariance).all()
    assert np.isnan(model.scatter).all()
    assert model.status == (Status.DIVERGED if updates else Status.WARMING_UP)


ANYTHING = st.sampled_from(
    [0.0, 1.0, -1.0, 1e-300, 5e-324, 1e150, -1e150, 1e300, 1.7e308, np.inf, -np.inf, np.nan]
)


@METHODS
@settings(deadline=None, max_examples=40)
@given(data=st.data())
def test_absurd_values_raise_nothing_and_tell_no_number_that_is_none(
    method: str, data: st.DataObject
):
    u, y = simulate(S3, 120, data.draw(st.integers(0, 20)))
    for x in (u, y):
        x[: data.draw(st.integers(0, 120))] *= data.draw(st.sampled_from([1.0, 0.0, 1e200, 1e-200]))
        for at in data.draw(st.lists(st.integers(0, 119), max_size=6)):
            x[at] = data.draw(ANYTHING)
    model = fit_record(config(method=method), u[:, None], y)

    if model.status == Status.TRACKING:
        assert np.isfinite(model.theta).all()
        assert np.isfinite(model.covariance).all()
        assert np.isfinite(model.scatter).all()
        assert np.isfinite(model.innovation_std)
    else:
        assert_nothing(model, model.updates)
        assert model.updates in (0, 1)
