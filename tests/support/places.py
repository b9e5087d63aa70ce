"""The folders and logs of the project, for tests in any folder."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
SRC, TESTS, TOOLS = ROOT / "src" / "yawid", ROOT / "tests", ROOT / "tools"
REPLAY_LOGS = ROOT / "replay_logs"
C172P = REPLAY_LOGS / "c172p_3211" / "log.tlog"
SHARED_FLIGHTS = ROOT / ".." / "shared" / "flights"
"""Recorded flights that are not part of the project; without them their tests are skipped."""
