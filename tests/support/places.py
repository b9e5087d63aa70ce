"""Where things lie, for tests at any depth."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
SRC, TESTS, TOOLS = ROOT / "src" / "yawid", ROOT / "tests", ROOT / "tools"
REPLAY_LOGS = ROOT / "replay_logs"
C172P = REPLAY_LOGS / "c172p_3211" / "log.tlog"
SHARED_FLIGHTS = ROOT / ".." / "shared" / "flights"
"""Recorded flights that are not part of the project: tests of them skip where they are absent."""
