"""What a mask hides is not read, and what a forged run holds is no command to a terminal."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damper.test_study import doublets
from finished_runs import replayed
from forged_runs import forge
from places import C172P

import yawid

ESC = "\x1b[31mUSABLE\x1b[0m\u202e"


def record() -> tuple[dict[str, Any], np.ndarray]:
    """A record, and which of its rows a mask hides."""
    u, r = doublets()
    t = 10.0 + 0.05 * np.arange(len(u))
    hidden = np.zeros(len(t), bool)
    hidden[[40, 41, 300, 301, 302, 700]] = True
    return {"t": t, "rudder": u, "r [rad/s]": r}, hidden


def test_what_the_mask_of_an_array_hides_is_missing_as_nan_is() -> None:
    data, hidden = record()
    options: dict[str, Any] = {"rudder_unit": "half-travel", "rudder_is": "commanded"}
    r = np.where(hidden, 9.0, data["r [rad/s]"])  # what stands below a mask means nothing
    with_nan = yawid.replay(data | {"r [rad/s]": np.where(hidden, np.nan, r)}, **options)
    masked = yawid.replay(data | {"r [rad/s]": np.ma.masked_array(r, hidden)}, **options)

    assert np.isnan(masked.samples.r).any()
    assert np.nanmax(masked.samples.r) < 1.0
    np.testing.assert_array_equal(masked.samples.r, with_nan.samples.r)
    assert masked.summary.estimates == with_nan.summary.estimates
    whole = np.ma.masked_array(data["r [rad/s]"])  # nothing is hidden
    np.testing.assert_array_equal(
        yawid.replay(data | {"r [rad/s]": whole}, **options).samples.r,
        yawid.replay(data, **options).samples.r,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name there")
def test_the_repr_of_a_forged_run_has_no_command_to_a_terminal(tmp_path: Path) -> None:
    def with_commands(summary: dict[str, Any]) -> dict[str, Any]:
        reason = {"id": "rate_low", "weight": "warning", "text": f"low {ESC}"}
        for each in (summary, *(summary[name] for name in ("flight",) if name in summary)):
            each["verdict"]["reasons"] = [reason]
        return summary

    run = replayed(C172P, tmp_path / "run", "--rate", 10)
    forged = yawid.load(forge(run, tmp_path / f"{ESC}.mcap", summary=with_commands))

    assert ESC in forged.summary.deciding.reasons[0].text
    for text in (repr(forged), str(forged), forged._repr_html_()):
        assert r"low \x1b[31mUSABLE\x1b[0m\u202e" in text
        assert not set("\x1b\u202e") & set(text)
