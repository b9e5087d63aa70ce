"""Two commits are compared bit by bit, and what differs is named."""

from __future__ import annotations

from checks.compare import differences


def test_what_differs_is_named_down_to_its_last_key_with_both_values() -> None:
    old = {"exit_code": 0, "flight": {"wn": 2.0, "reasons": [{"id": "a"}], "K": float("nan")}}
    new = {"exit_code": 5, "flight": {"wn": 2, "reasons": [{"id": "b"}, 3], "K": float("nan")}}

    assert dict(differences(old, new)) == {
        "exit_code": "0, 5",
        "flight.wn": "2.0, 2",
        "flight.reasons.0.id": "'a', 'b'",
        "flight.reasons.1": "None, 3",
    }
    assert not dict(differences(old, old))
