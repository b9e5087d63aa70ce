"""The bench of what a short run costs, with one round of the cheap processes."""

from __future__ import annotations

from bench import start as bench


def test_a_round_of_the_short_processes_fills_its_cells_in_ratios_and_the_rest_stay_empty(
    monkeypatch,
):
    monkeypatch.setattr(bench, "MOST_OF_NUMPY", 0.0)
    monkeypatch.setattr(bench.Bench, "compile", lambda self: None)
    compared = []

    def instead_of_hours(self, logs):
        mcap = self._folder / "log.mcap"
        compared.append((bench.equal_messages(mcap, mcap), len(logs)))

    monkeypatch.setattr(bench.Bench, "hours", instead_of_hours)
    options = ["--rounds", "1", "--hours", ".02", "--hour-rounds", "1", "--cold-rounds", "0"]
    told, lines = bench.main(options), []
    try:
        while True:
            lines.append(next(told))
    except StopIteration as end:
        missed = end.value

    (row,) = (line.strip("|").split("|") for line in lines[2:])
    name, numpy_s, help_s, replay_s, wall_s, *others = map(str.strip, row)
    assert name == "now"
    assert 0 < float(numpy_s) < float(replay_s.split(" (")[0])
    assert float(help_s.split(" (")[0]) > 0 < float(wall_s)
    assert set(others) == {""}
    assert missed.startswith("a replay: ")
    ((equal, count), logs) = compared[0]
    assert equal == count > 1000
    assert logs == 2


def test_a_cold_replay_that_takes_too_long_or_writes_something_else_is_a_miss():
    seconds = {bench.NUMPY: 0.1, bench.SHORT: 0.7, bench.SHORT_WALL: 0.8, bench.COLD: 1.2}
    assert bench.missed(seconds, {(9, 9)}) is None

    missed = bench.missed(seconds | {bench.COLD: 1.7}, {(9, 9), (8, 9)})

    assert missed == (
        "cold, wall; messages: 2.1 x its wall; 2 is allowed; "
        "8 of 9 messages of a cold replay are equal"
    )
    row = bench.row("now", seconds | {"an hour": 0.6}, {(9, 9)})
    assert (
        row == "| now | 0.1 |  | 0.7 (7) | 0.8 | 1.2 (1.5 x warm), 9 of 9 equal |  | 0.6 (6) |  |"
    )


def test_one_more_hour_is_the_difference_of_the_least_of_each_log(tmp_path):
    measured = bench.Bench(tmp_path, tmp_path)
    for short_s, long_s in ((1.0, 1.9), (1.2, 1.6)):
        measured._keep("an hour 0", short_s)
        measured._keep("an hour 1", long_s)

    assert measured.seconds(hours=0.5) == {"an hour": 2.0 * (1.6 - 1.0)}
