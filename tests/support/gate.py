"""Chooses the cases of a long test that run in the gate; ``tools/check.py --long`` runs all."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def one_in(n: int, values: Iterable[Any]) -> list[Any]:
    """Return parameters; the first and every ``n``-th after it run in the gate, others are long."""
    return [
        pytest.param(value, marks=() if i % n == 0 else pytest.mark.long)
        for i, value in enumerate(values)
    ]
