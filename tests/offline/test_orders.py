from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from places import C172P
from printed import printed

from yawid.cli.main import main
from yawid.config.estimator import ArmaxOrders
from yawid.errors import NotIdentifiable
from yawid.offline.orders import candidates, compare_orders, recommended


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
    tried = [
        ArmaxOrders(na=na, nb=na, nc=nc, nk=k)
        for na in (1, 2, 3)
        for nc in (0, 1)
        for k in (1, 2, 3)
    ]

    found = compare_orders(u, y, 0.1, tried)

    best = recommended(found)
    assert (best.orders.na, best.orders.nb, best.orders.nk) == (2, (2,), (nk,))
    assert [c.simulation_pct for c in found] == sorted(
        (c.simulation_pct for c in found), reverse=True
    )
    assert best.loss == pytest.approx(0.09, rel=0.15)


def test_held_samples_do_not_count_and_too_few_are_refused():
    u, y = second_order(400, 1, 0.1)
    y[:250] = np.nan

    with pytest.raises(NotIdentifiable, match="150 samples"):
        compare_orders(u, y, 0.1, [ArmaxOrders(na=2, nb=2, nc=1, nk=1)])


def test_the_candidates_cover_the_default():
    assert ArmaxOrders(na=3, nb=3, nc=2, nk=1) in candidates(1)
    assert all(orders.n_inputs == 2 for orders in candidates(2))
    assert ArmaxOrders(na=3, nb=4, nc=2, nk=1) in candidates(1, extra_b=1)


def test_orders_auto_replays_with_what_orders_recommends(tmp_path: Path, capsys):
    options = ["--rate", "10"]
    assert main(["orders", str(C172P), "--json", *options]) == 0
    report = printed("orders", capsys.readouterr().out)

    out = ["--out", str(tmp_path), "--json"]
    assert main(["replay", str(C172P), "--orders", "auto", *options, *out]) == 0
    summary = json.loads(capsys.readouterr().out)

    assert summary["estimates"]["els"]["orders"] == report["recommended"]
    assert report["recommended"]["nk"] == 1
