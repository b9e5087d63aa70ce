"""A page must not contradict its own answer, and every output says what it means in plain words."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from PIL import Image
from places import REPLAY_LOGS, ROOT, SRC
from report_page import Page, first_screen

import yawid
from yawid.cli.main import main

PHRASES = (
    "else 'nowhere'", "which does not show the servo's lag",
    "starts of the servo lag agree with", "sigma of L_delta_a is",
    "would cancel the aileron's yaw alone", "takes damping from th",
    "noise gives so large a B with",
)  # fmt: skip
"""Sentences without a subject, or in the terms of the code."""


@pytest.fixture(scope="module")
def three_speeds(tmp_path_factory: pytest.TempPathFactory) -> tuple[yawid.Run, str]:
    """A flight with twelve manoeuvres, usable, and its report."""
    run = yawid.replay(REPLAY_LOGS / "c172p_three_speeds" / "log.tlog")
    assert run.usable
    assert run.flight.method == "ct"
    page = run.report(tmp_path_factory.mktemp("report") / "R.html")
    return run, page.read_text(encoding="utf-8")


def captions(html: str) -> list[str]:
    return [Page(each).text for each in re.findall(r"<figcaption.*?</figcaption>", html, re.DOTALL)]


def test_no_caption_asks_for_noise_parameters_that_the_answer_does_not_have(
    three_speeds: tuple[yawid.Run, str],
) -> None:
    assert [each for each in captions(three_speeds[1]) if "raise nc" in each] == []


def test_no_caption_of_a_usable_answer_says_that_its_order_is_wrong(
    three_speeds: tuple[yawid.Run, str],
) -> None:
    assert "Can I use it? Yes" in first_screen(three_speeds[1])
    assert [each for each in captions(three_speeds[1]) if "wrong order" in each] == []


def test_every_manoeuvre_has_its_number_in_the_picture_of_the_flight(
    three_speeds: tuple[yawid.Run, str],
) -> None:
    run, html = three_speeds
    (figure,) = re.findall(r'<figure id="whole">.*?</figure>', html, re.DOTALL)
    written = {text.strip() for text in re.findall(r"<text[^>]*>([^<]*)<", figure)}

    assert {str(each.n) for each in run.summary.manoeuvres} - written == set()


def test_the_remedy_that_helps_comes_before_those_that_cannot(tmp_path: Path) -> None:
    """The rudder follows the aileron: neither more samples nor another order help."""
    run = yawid.replay(REPLAY_LOGS / "sitl_auto" / "log.tlog")
    said = first_screen(run.report(tmp_path / "R.html").read_text(encoding="utf-8"))
    assert run.summary.verdict.reasons[0].id == "mixed_rudder"

    helps = said.index("Move the rudder without the aileron")
    vain = ("compare orders", "Choose a calmer stretch", "Choose a stretch of straight flight")
    assert [each for each in vain if 0 <= said.find(each) < helps] == []


def test_a_warning_is_called_one_wherever_it_stands(tmp_path: Path, capsys) -> None:
    log = REPLAY_LOGS / "c172p_gcs_rates" / "log.tlog"
    assert main(["replay", str(log), "--out", str(tmp_path)]) == 0
    assert main(["report", str(tmp_path / "log.mcap")]) == 0

    assert "  warning rate_low: yaw comes at 10 Hz" in capsys.readouterr().out
    page = first_screen((tmp_path / "log.html").read_text(encoding="utf-8"))
    assert "warning rate_low" in page


def test_no_odd_phrase_is_left() -> None:
    texts = [*SRC.rglob("*.py"), *SRC.rglob("*.md"), *(ROOT / "src").glob("*.md")]
    pages = {path: path.read_text(encoding="utf-8") for path in texts if path.name != "changes.md"}
    said = {
        path: " ".join(re.sub(r'["{}]|\bf"', " ", text).split()) for path, text in pages.items()
    }

    found = [(path.name, each) for path in said for each in PHRASES if each in said[path]]
    assert found == []


@pytest.mark.parametrize("name", ["rerun", "report"])
def test_a_picture_of_the_readmes_shows_the_answer_that_is_given_today(name: str) -> None:
    """The one command that draws both writes into each what it shows: case, options, answer."""
    with Image.open(ROOT / "tools" / "pictures" / f"{name}.png") as image:
        source = json.loads(image.info["yawid"])
    run = yawid.replay(REPLAY_LOGS / source["case"] / "log.tlog", **source["options"])

    shown, mode = source["dutch_roll"], run.flight.dutch_roll
    for key in ("wn_rad_s", "wn_std", "zeta", "zeta_std"):
        assert shown[key] == pytest.approx(getattr(mode, key), rel=2e-3)
