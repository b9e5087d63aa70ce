"""A stretch of motion says what is wrong with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from yawid.errors import ConfigError
from yawid.lateral.motion import COMMAND_STEP_S, Motion


def motion(**changed: Any) -> Motion:
    """Return one second of rest at 10 Hz with commands from half a second before."""
    zero = np.zeros(10)
    commands = np.zeros(round(1.5 / COMMAND_STEP_S))
    given: dict[str, Any] = {
        "sample_time_s": 0.1, "p": zero, "r": zero, "roll": zero, "pitch": zero, "q": zero,
        "commands_start_s": -0.5, "rudder": commands, "aileron": commands, "airspeed_m_s": 40.0,
    }  # fmt: skip
    return Motion(**(given | changed))


def test_the_commands_times_begin_before_the_measurements() -> None:
    times = motion().command_times_s()

    assert times[0] == -0.5
    assert times[100] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"sample_time_s": 0.0}, "sample time and airspeed"),
        ({"airspeed_m_s": float("nan")}, "sample time and airspeed"),
        ({"roll": np.zeros(9)}, "same length"),
        ({"rudder": np.full(300, np.nan)}, "finite"),
        ({"commands_start_s": 0.1}, "must cover"),
        ({"commands_start_s": -0.9}, "must cover"),
    ],
)
def test_a_motion_that_cannot_be_fitted_is_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        motion(**changed)
