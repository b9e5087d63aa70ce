"""Which cases of a long test are in the gate; ``tools/check.py --long`` runs the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def one_in(n: int, values: Iterable[Any]) -> list[Any]:
    """Return parameters of which the first and every ``n``-th after it are in the gate."""
    return [
        pytest.param(value, marks=() if i % n == 0 else pytest.mark.long)
        for i, value in enumerate(values)
    ]
