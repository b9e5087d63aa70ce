"""The pictures that zoom: their numbers are those of the run, and a browser zooms in them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished_runs import replayed
from matplotlib.figure import Figure
from pictures.browser import chromium, find_chromium, opened
from places import C172P
from playwright.sync_api import Page as Tab
from report_page import Page

from yawid.report.data import gather
from yawid.report.html import page as whole_page
from yawid.report.html import pictures
from yawid.report.picture import Picture
from yawid.report.write import report
from yawid.report.zoom import MOST_POINTS, thinned
from yawid.sinks.mcap.reader import McapRun, open_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> McapRun:
    return open_run(replayed(C172P, tmp_path_factory.mktemp("run")))


@pytest.fixture(scope="module")
def html(run: McapRun) -> str:
    return str(report(run))  # not Markup, which would escape what a test puts into it


def numbers_in(html: str) -> dict[str, Any]:
    """Return the numbers of each picture in a page that zooms, by the picture's id."""
    figures = re.findall(r'<figure id="([^"]+)">(.*?)</figure>', html, re.DOTALL)
    return {key: Page(body).numbers[0] for key, body in figures if Page(body).numbers}


def line(picture: Any, panel: int, at: int = -1) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Return a line's x (n,) and y (n,) as chart.js has them, and the units of both."""
    drawn = picture["panels"][panel]["lines"][at]
    unit_x, *steps = picture["xs"][drawn["x"]]
    unit_y, *multiples = drawn["y"]
    x = np.cumsum(steps) * unit_x if unit_x else np.array(steps)
    return x, np.array(multiples, np.float64) * (unit_y or 1.0), unit_x, unit_y


def test_the_numbers_in_the_page_are_the_samples_of_the_run(run: McapRun, html: str) -> None:
    data, found = gather(run), numbers_in(html)
    assert data is not None
    (fit,) = data.drawn
    t, samples, flown = data.samples.boot_us / 1e6, data.samples, fit.measured

    cases = [
        ("whole", 0, -1, t, samples.u[:, 0]),
        ("whole", 1, -1, t, samples.y),
        ("manoeuvre1", -3, -1, flown.t, flown.u[:, 0]),
        ("manoeuvre1", -2, 0, flown.t, flown.y),
        ("manoeuvre1", -2, 1, flown.t, flown.simulated),
        ("manoeuvre1", -1, -1, flown.t, flown.y - flown.simulated),
    ]
    for key, panel, at, true_t, true_y in cases:
        x, y, unit_x, unit_y = line(found[key], panel, at)
        last = len(true_t) - len(x)  # a second boot, or rows after a gap, are lines of their own
        np.testing.assert_allclose(x, true_t[last:], rtol=0.0, atol=0.51 * unit_x)
        np.testing.assert_allclose(y, true_y[last:], rtol=0.0, atol=0.51 * unit_y)
        assert len(x) > 0.9 * len(true_t)
        low, high = found[key]["panels"][panel]["y"]
        assert unit_y <= 1e-4 * (high - low)
    assert set(found) == {"whole", "manoeuvre1", "bode", "step", "residuals"}


def test_of_a_long_line_every_least_and_greatest_stays_and_gaps_do() -> None:
    rng = np.random.default_rng(4)
    y = rng.normal(size=123_456).cumsum()
    y[50_000:60_000] = np.nan

    rows = thinned(y)

    assert len(rows) <= MOST_POINTS
    assert (np.diff(rows) > 0).all()
    step = -(-len(y) // (MOST_POINTS // 2))
    bins = np.arange(0, len(y), step)
    for reduced in (np.fmin, np.fmax):
        kept = np.full(len(y), np.nan)
        kept[rows] = y[rows]
        np.testing.assert_array_equal(reduced.reduceat(kept, bins), reduced.reduceat(y, bins))
    gap = (rows > 50_000 + step) & (rows < 60_000 - step)
    assert gap.any()
    assert np.isnan(y[rows[gap]]).all()
    np.testing.assert_array_equal(thinned(y[:MOST_POINTS]), np.arange(MOST_POINTS))


def test_a_line_that_goes_back_in_time_has_pieces_that_ascend_and_a_name_is_only_a_text() -> None:
    name = "</script><img src=x onerror=alert(1)>"
    t = np.r_[5.0:9.0:0.01, 1.0:7.0:0.01]
    y = np.where(np.arange(len(t)) == 7, np.nan, np.sin(t) * np.where(t == t[9], 1e300, 1.0))

    def draw(figure: Figure) -> None:
        ax = figure.subplots()
        ax.plot(t, y, label=name)
        ax.axvline(3.0)
        ax.set(ylim=(-1.0, 1.0), xlabel="s")

    html = Picture("one", "One", "", draw, zooms=True).html

    assert name not in html
    (found,) = Page(html).numbers
    (panel,) = found["panels"]
    assert [each["name"] for each in panel["lines"]] == [name, name]
    pieces = [line(found, 0, at) for at in (0, 1)]
    assert [(x[0], len(x)) for x, *_ in pieces] == [(5.0, 400), (pytest.approx(1.0), 600)]
    assert all((np.diff(x) > 0.0).all() for x, *_ in pieces)
    assert panel["lines"][0]["y"][1 + 7] is None
    assert abs(panel["lines"][0]["y"][1 + 9]) < 1e15  # whole numbers stay exact in a browser
    assert [(each["at"], each["upright"]) for each in panel["levels"]] == [(3.0, True)]
    assert Page(html).tags.count("img") == 0


def span(tab: Tab, key: str) -> list[float]:
    """Return the range that a picture's charts say that they show."""
    label = tab.locator(f"#{key} .zoom").get_attribute("aria-label")
    return [float(each) for each in (label or "").rpartition(", ")[2].split(" to ")]


def at(tab: Tab, key: str, panel: int, x: float, y: float = 0.5) -> tuple[float, float]:
    """Return a place in a panel, from parts of its width and height, scrolled into view."""
    over = tab.locator(f"#{key} .u-over").nth(panel)
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    assert box is not None
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def dragged(tab: Tab, start: tuple[float, float], end: tuple[float, float]) -> None:
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*end, steps=4)
    tab.mouse.up()


WITHIN = pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")


@pytest.fixture
def page(html: str, tmp_path: Path) -> str:
    (tmp_path / "page.html").write_text(html, encoding="utf-8")
    return (tmp_path / "page.html").as_uri()


@WITHIN
def test_a_drag_zooms_every_picture_over_the_same_axis_and_a_double_click_shows_all(
    page: str, run: McapRun
) -> None:
    samples = gather(run).samples
    with chromium() as browser:
        tab, requests, complaints = opened(browser, page)
        keys = ("whole", "manoeuvre1", "bode", "residuals", "step")
        before = {key: span(tab, key) for key in keys}
        low, high = before["whole"]

        dragged(tab, at(tab, "whole", 1, 0.4), at(tab, "whole", 1, 0.5))
        expected = [low + part * (high - low) for part in (0.4, 0.5)]
        assert span(tab, "whole") == pytest.approx(expected, abs=0.01 * (high - low))
        assert span(tab, "manoeuvre1") == pytest.approx(span(tab, "whole"), abs=1e-3)
        assert {key: span(tab, key) for key in keys[2:]} == {key: before[key] for key in keys[2:]}

        # The instant is that of the drag's end; the values at the cursor are the run's.
        ended = tab.locator("#whole .zoom p").first.inner_text().split()[4]
        assert float(ended) == pytest.approx(expected[1], abs=0.01 * (high - low))
        tab.mouse.move(*at(tab, "whole", 1, 0.5))
        said = tab.locator("#whole .zoom p").all_inner_texts()
        numbers = [re.findall(r" (-?[\d.]+(?:e-\d+)?)", each)[-1] for each in said]
        instant, rudder, yaw = map(float, numbers)
        nearest = int(np.argmin(np.abs(samples.boot_us / 1e6 - instant)))
        around = slice(nearest - 1, nearest + 2)
        assert instant == pytest.approx(sum(expected) / 2.0, abs=0.01 * (high - low))
        assert np.abs(samples.y[around] - yaw).min() < 1e-4
        assert np.abs(samples.u[around, 0] - rudder).min() < 1e-4

        # The panel of the whole record moves the stretch; a slanted drag also zooms in height.
        dragged(tab, at(tab, "manoeuvre1", 0, 0.1), at(tab, "manoeuvre1", 0, 0.2))
        assert span(tab, "manoeuvre1")[1] < before["manoeuvre1"][0]
        dragged(tab, at(tab, "bode", 0, 0.4, 0.2), at(tab, "bode", 0, 0.6, 0.7))
        assert span(tab, "bode") == pytest.approx(span(tab, "residuals"), rel=1e-3)
        assert span(tab, "bode")[0] > before["bode"][0]

        tab.mouse.dblclick(*at(tab, "manoeuvre1", 2, 0.5))
        tab.locator("#bode .zoom button").press("Enter")
        assert {key: span(tab, key) for key in keys} == before
        assert tab.locator(".zoom button:visible").count() == 0
        assert requests == [page]
        assert complaints == []


@WITHIN
def test_on_a_phone_a_finger_zooms_a_double_tap_shows_all_and_nothing_is_too_wide(
    page: str,
) -> None:
    with chromium() as browser:
        tab, _, complaints = opened(browser, page, 390, 844, phone=True)
        before = span(tab, "step")
        (x, y), (end, _) = at(tab, "step", 0, 0.2), at(tab, "step", 0, 0.5)
        touch = tab.context.new_cdp_session(tab)

        def finger(kind: str, *places: float) -> None:
            points = [{"x": each, "y": y} for each in places]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        def swiped() -> list[float]:
            finger("touchStart", x)
            for part in (0.3, 0.6, 1.0):
                finger("touchMove", x + part * (end - x))
            finger("touchEnd")
            return span(tab, "step")

        width = before[1] - before[0]
        expected = [before[0] + part * width for part in (0.2, 0.5)]
        assert swiped() == pytest.approx(expected, abs=0.05 * width)
        for _ in range(2):  # a double tap
            finger("touchStart", x)
            finger("touchEnd")
        assert span(tab, "step") == before
        assert swiped() == pytest.approx(expected, abs=0.05 * width)
        assert tab.evaluate("document.documentElement.scrollWidth") == 390
        boxes = (
            "[...document.querySelectorAll('.zoom *')].map(e => e.getBoundingClientRect().right)"
        )
        assert max(tab.evaluate(boxes)) <= 390
        tab.locator("#step .zoom button").click()
        assert span(tab, "step") == before
        assert complaints == []


@WITHIN
def test_a_script_that_is_not_its_own_does_not_run_in_the_page(html: str, tmp_path: Path) -> None:
    foreign = "<script>document.title = 'foreign'</script></body>"
    guarded = html.replace("</body>", foreign)
    bare = re.sub("<meta http-equiv=.*?>", "", guarded, count=1)
    assert foreign in bare
    assert "Content-Security-Policy" not in bare
    with chromium() as browser:
        for text, title in ((guarded, "log.tlog - yawid report"), (bare, "foreign")):
            path = tmp_path / f"{title}.html"
            path.write_text(text, encoding="utf-8")
            tab, *_ = opened(browser, path.as_uri())
            assert tab.title() == title
            assert len(span(tab, "whole")) == 2  # its own run


@WITHIN
def test_logarithmic_axes_may_begin_anywhere_and_zoom_to_less_than_a_tick(tmp_path: Path) -> None:
    """The chart's library never ends on an axis that begins just below a decade."""
    lows = 0.0998, 0.00999, 0.97, 1.0, 3.3e-9, 999.0

    def shown(i: int, low: float) -> Picture:
        x = np.geomspace(low, 45.0 * low, 50)

        def draw(figure: Figure) -> None:
            ax = figure.subplots()
            ax.loglog(x, x**-2.0)
            ax.set(xlim=(x[0], x[-1]), ylim=(x[-1] ** -2.0, x[0] ** -2.0), xlabel=f"x{i}")

        return Picture(f"log{i}", "", "", draw, zooms=True)

    path = tmp_path / "page.html"
    drawn = pictures("", [shown(i, low) for i, low in enumerate(lows)])
    path.write_text(whole_page("logarithmic", [drawn]), encoding="utf-8")
    with chromium() as browser:
        tab, _, complaints = opened(browser, path.as_uri())
        for i, low in enumerate(lows):
            assert span(tab, f"log{i}") == pytest.approx([low, 45.0 * low], rel=0.01)
        dragged(tab, at(tab, "log0", 0, 0.5), at(tab, "log0", 0, 0.55))
        wanted = [0.0998 * 45.0**part for part in (0.5, 0.55)]
        assert span(tab, "log0") == pytest.approx(wanted, rel=0.02)
        assert complaints == []


BRIGHT = """() => { const [r, g, b] = getComputedStyle(document.body)[%r].match(/\\d+/g);
  return (+r + +g + +b) / 3; }"""
SEEN = """kind => [...document.querySelectorAll(`#whole ${kind}`)].filter(
  each => each.getBoundingClientRect().height > 50).length"""


@WITHIN
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_without_script_and_on_paper_it_has_the_drawn_pictures_in_light_and_dark(
    page: str, dark: bool
) -> None:
    with chromium() as browser:
        shown, *_ = opened(browser, page, dark=dark)
        plain, *_ = opened(browser, page, dark=dark, script=False)
        assert [shown.evaluate(SEEN, kind) for kind in ("canvas", "svg")] == [2, 0]
        assert [plain.evaluate(SEEN, kind) for kind in ("canvas", "svg")] == [0, 1]
        for tab in (shown, plain):
            paper, ink = (tab.evaluate(BRIGHT % kind) for kind in ("backgroundColor", "color"))
            assert (paper < 60, ink > 200) == (dark, dark)

        shown.emulate_media(media="print")
        assert [shown.evaluate(SEEN, kind) for kind in ("canvas", "svg")] == [0, 1]
        assert shown.evaluate(BRIGHT % "backgroundColor") == 255
