"""The time that a fleet says is left, against a schedule of the costs measured on replay_logs."""

from __future__ import annotations

import heapq
from pathlib import Path

import pytest

from yawid.fleet.find_logs import FoundLog
from yawid.fleet.run_fleet import FleetRun, Progress, plan_of

COSTS = (
    (45225, 0.02),
    (103425, 0.38),
    (156354, 0.88),
    (200205, 0.5),
    (200205, 0.53),
    (200205, 0.52),
    (200205, 0.49),
    (200571, 0.49),
    (202922, 0.5),
    (204210, 0.51),
    (222345, 0.46),
    (223290, 1.34),
    (265998, 0.5),
    (399510, 0.45),
    (400410, 0.99),
    (506625, 0.53),
    (555533, 0.86),
    (601586, 0.8),
    (736184, 0.37),
    (794450, 0.8),
    (913545, 2.11),
)
"""Size in bytes and CPU time in s of each log of replay_logs, with default options."""
LONG = [(mb * 1_000_000, 0.3 + 0.99 * mb) for mb in range(10, 60)]


@pytest.mark.parametrize("more", [[], LONG])
def test_after_a_tenth_of_the_logs_the_time_left_is_known_within_a_factor_of_one_and_a_half(
    more: list[tuple[int, float]],
):
    costs = dict(enumerate([*COSTS * 20, *more]))
    logs = [FoundLog(f"{i}.tlog", size, "0") for i, (size, _) in costs.items()]
    logs.sort(key=lambda log: -log.size)  # as they are found
    todo = plan_of(FleetRun(paths=[], out=Path()), logs, {}).todo
    assert {log.path for log in todo} == {log.path for log in logs}

    free, ends = [0.0, 0.0], []
    for log in todo:
        end = heapq.heappop(free) + costs[int(log.path[:-5])][1]
        heapq.heappush(free, end)
        ends.append((end, log.size))
    ends.sort()
    progress, last = Progress(logs), ends[-1][0]
    for i, (passed_s, size) in enumerate(ends, 1):
        progress.add("ok", size)
        if i >= len(logs) / 10 and last - passed_s > last / 20:
            assert 1 / 1.5 < progress.left_s(passed_s) / (last - passed_s) < 1.5
