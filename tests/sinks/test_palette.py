"""The colours of all pictures: seen on paper, on the viewer's dark ground, and by everybody."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from yawid.sinks import palette
from yawid.sinks.palette import AILERON, BAD, BARE, DATA, METHODS, MODEL, NEUTRAL, RUDDER, rgba

LINES = {"data": DATA, "model": MODEL, **METHODS, "rudder": RUDDER, "bad": BAD,
         "neutral": NEUTRAL, "aileron": AILERON, "bare": BARE}  # fmt: skip
DARK = "#0d1011"
MEET = (
    ("data", "model", "rudder", "neutral"),
    ("els", "rml", "model", "bad", "neutral"),
    ("rudder", "aileron"),
    ("model", "neutral", "bare"),
    ("data", "bare"),
    ("els", "rml", "bad", "neutral", "bare"),
)
"""Lines of one picture."""
# Severity 1.0 of Machado, Oliveira and Fernandes (2009), on linear RGB.
SIGHTS = {
    "all colours": np.eye(3),
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def linear(colour: str) -> np.ndarray:
    c = np.array(rgba(colour)[:3]) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def luminance(colour: str) -> float:
    return float(linear(colour) @ [0.2126, 0.7152, 0.0722])


def lab(rgb: np.ndarray) -> np.ndarray:
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.array(to_xyz) @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_a_line_is_seen_on_paper_and_on_the_viewers_dark_ground() -> None:
    own = {name: luminance(colour) + 0.05 for name, colour in LINES.items()}
    assert 1.05 / max(own.values()) > 2.9
    assert min(own.values()) / (luminance(DARK) + 0.05) > 2.9


@pytest.mark.parametrize("sight", SIGHTS)
def test_lines_that_meet_in_a_picture_and_parameters_differ_to_every_eye(sight: str) -> None:
    seen = {name: lab(np.array(SIGHTS[sight]) @ linear(c)) for name, c in LINES.items()}
    pairs = {pair for some in MEET for pair in combinations(some, 2)}
    near = {pair: float(np.linalg.norm(seen[pair[0]] - seen[pair[1]])) for pair in pairs}

    assert min(near.values()) > 9.0, min(near, key=lambda pair: near[pair])
    own = [lab(np.array(SIGHTS[sight]) @ linear(c)) for c in palette.LINES]  # of parameters
    assert min(float(np.linalg.norm(a - b)) for a, b in combinations(own, 2)) > 20.0


def test_a_parameter_s_colour_has_no_other_meaning() -> None:
    own, others = ([lab(linear(c)) for c in colours] for colours in (palette.LINES, LINES.values()))
    assert min(float(np.linalg.norm(a - b)) for a in own for b in others) > 15.0
