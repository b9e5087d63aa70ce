"""Recorded flights: whole ones if the shared folder is there, and the parts in the project.

The simulated flights (``sitl_*``) were recorded for the project, which has parts of them; the
others belong to their owners. Without the folder, the tests of whole flights are skipped.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from places import REPLAY_LOGS, ROOT, SHARED_FLIGHTS

OF_THE_PROJECT = {
    "sitl_fbwa_50hz": REPLAY_LOGS / "sitl_fbwa_50hz" / "log.tlog",
    "sitl_fbwa_stock_33hz": REPLAY_LOGS / "sitl_fbwa_stock_33hz" / "log.tlog",
    "sitl_auto_25hz": REPLAY_LOGS / "sitl_auto" / "log.tlog",
    "sitl_fbwa_gcs_4hz": ROOT / "tests" / "flights" / "sitl_fbwa_gcs_4hz.tlog",
    "sitl_auto_mavproxy_4hz": ROOT / "tests" / "flights" / "sitl_auto_mavproxy_4hz.tlog",
}
"""Parts of these flights with the essential messages, cut by tools/make_cases.py."""


def recorded(*names: str, trimmed: bool = True) -> pytest.MarkDecorator:
    """Return the mark that runs a test with ``log`` set to each of these flights.

    With ``trimmed``, the test also runs with the project's parts of them.
    """
    needs_shared = pytest.mark.skipif(
        not SHARED_FLIGHTS.is_dir(), reason="the recorded flights are not here"
    )
    found = []
    for name in names:
        whole: Path = SHARED_FLIGHTS / f"{name}.tlog"
        found.append(pytest.param(whole, id=name, marks=needs_shared))
        if trimmed and name in OF_THE_PROJECT:
            found.append(pytest.param(OF_THE_PROJECT[name], id=f"{name} trimmed"))
    return pytest.mark.parametrize("log", found)
