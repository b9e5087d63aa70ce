from __future__ import annotations

import numpy as np
import pytest
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.config.run import RunConfig
from yawid.errors import NotIdentifiable
from yawid.offline.orders import CANDIDATES, compare_orders


def second_order(n: int, nk: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    u = np.repeat(rng.choice([-1.0, 1.0], n // 8 + 1), 8)[:n]
    e = noise * rng.standard_normal(n)
    y = np.zeros(n)
    for k in range(4, n):
        y[k] = 1.6 * y[k - 1] - 0.8 * y[k - 2] + 0.5 * u[k - nk] + 0.3 * u[k - nk - 1]
        y[k] += e[k] - 0.7 * e[k - 1]
    return u[:, None], y


@pytest.mark.parametrize("nk", [1, 2])
def test_the_structure_that_made_the_record_is_recommended(nk: int):
    u, y = second_order(1500, nk, 0.3)
    tried = [(na, na, nc, k) for na in (1, 2, 3) for nc in (0, 1) for k in (1, 2, 3)]

    found, best = compare_orders(u, y, 0.1, RunConfig(), tried)

    assert (best.na, best.nb, best.nk) == (2, 2, nk)
    assert [c.simulation_pct for c in found] == sorted(
        (c.simulation_pct for c in found), reverse=True
    )
    [chosen] = [c for c in found if str(c) == str(best)]
    assert chosen.loss == pytest.approx(0.09, rel=0.15)


def test_held_samples_do_not_count_and_too_few_are_refused():
    u, y = second_order(400, 1, 0.1)
    y[:250] = np.nan

    with pytest.raises(NotIdentifiable, match="150 samples"):
        compare_orders(u, y, 0.1, RunConfig())


def test_the_candidates_cover_the_default_and_fit_two_inputs_and_the_yaw_angle():
    assert RunConfig().orders in CANDIDATES
    config = RunConfig(inputs=("rudder", "aileron"), output="yaw")
    u, y = second_order(1500, 1, 0.3)
    both = np.column_stack([u, np.roll(u, 17)])
    [found], _ = compare_orders(both, y, 0.1, config, [(2, 2, 1, 1)])
    assert str(found) == "2,2,1,1"


def test_orders_takes_the_manoeuvre_s_samples_says_its_rule_and_marks_its_row(capsys):
    options = ["orders", str(C172P), "--rate", "10"]
    assert main([*options, "--json"]) == 0
    report = printed("orders", capsys.readouterr().out)
    assert main(options) == 0
    shown = capsys.readouterr().out.splitlines()

    best = ",".join(str(report["recommended"][name]) for name in ("na", "nb", "nc", "nk"))
    assert report["manoeuvres"] == 1
    assert report["recommended"]["nk"] == 1
    assert [line.split()[1] for line in shown if line.startswith("->")] == [best]
    assert "1 manoeuvres' samples" in " ".join(shown)
    assert "ns" not in shown[1].split()
