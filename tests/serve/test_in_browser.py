"""The pages of ``yawid serve`` in a browser: logs dropped at once, zoom, dark, a phone's width."""

from __future__ import annotations

import os
import re
from base64 import b64encode
from itertools import product
from pathlib import Path

import pytest
from pictures.browser import chromium, find_chromium, opened
from places import C172P, REPLAY_LOGS
from serving import LIMIT_S, served

OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
DROPPED = """(logs) => {
  const given = new DataTransfer();
  for (const [name, text] of Object.entries(logs))
    given.items.add(new File([Uint8Array.from(atob(text), (c) => c.charCodeAt(0))], name));
  document.dispatchEvent(new DragEvent("drop", { dataTransfer: given, cancelable: true }));
}"""
SHADE = """(of) => {
  const [r, g, b] = getComputedStyle(document.querySelector(of.place))[of.name].match(/\\d+/g);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}"""


@pytest.mark.skipif(find_chromium() is None, reason="no chromium is installed")
def test_three_logs_dropped_at_once_are_answered_junk_has_its_line_and_a_report_zooms(
    tmp_path: Path,
) -> None:
    """YAWID_TEST_PICTURES names a folder for pictures of the pages, to be looked at."""
    (tmp_path / "junk.tlog").write_bytes(bytes(range(7, 256)) * 40)
    (tmp_path / "one.tlog").write_bytes(C172P.read_bytes())
    (tmp_path / "two.tlog").write_bytes((REPLAY_LOGS / "no_rudder" / "log.tlog").read_bytes())
    folder = tmp_path / "flights"
    folder.mkdir()
    logs = sorted(tmp_path.glob("*.tlog"))
    with served(folder) as of, chromium() as browser:
        address = str(of.client.base_url)
        page, requests, complaints = opened(browser, address)
        page.set_default_timeout(1000.0 * LIMIT_S)
        page.evaluate(DROPPED, {each.name: b64encode(each.read_bytes()).decode() for each in logs})
        page.locator("tr.pale .bad").first.wait_for(timeout=1000.0 * LIMIT_S)
        page.locator(".good").wait_for(timeout=1000.0 * LIMIT_S)
        page.locator("tr", has_text="two.tlog").locator(".bad").wait_for(timeout=1000.0 * LIMIT_S)

        assert sorted(each.name for each in folder.glob("*.tlog")) == [each.name for each in logs]
        assert "2.400 ± 0.054" in page.locator("tr", has_text="one.tlog").inner_text()
        junk = page.locator("tr", has_text="junk.tlog")
        assert "holds no intact MAVLink record" in junk.inner_text()
        assert page.locator("#sent li").count() == 0

        assert all(each.startswith(address) for each in requests if not each.startswith("data:"))
        page.get_by_role("link", name="one.tlog").click()
        page.locator("h1", has_text="one.tlog").wait_for(timeout=1000.0 * LIMIT_S)
        over, all_of_it = page.locator("#whole .u-over").first, page.locator("#whole .zoom button")
        assert not all_of_it.is_visible()
        over.drag_to(over, source_position={"x": 90, "y": 40}, target_position={"x": 210, "y": 40})
        assert all_of_it.is_visible()
        seconds = re.findall(r"[\d.]+", page.locator("#whole .zoom").get_attribute("aria-label"))
        assert float(seconds[1]) - float(seconds[0]) < 40.0
        assert complaints == []

        for width, dark in product((1280, 360), (False, True)):
            for what, place, ink in (("list", "", ".good"), ("report", "/flights/one.tlog", "h1")):
                shown, _, complaints_there = opened(
                    browser, address + place, width, phone=width < 400, dark=dark
                )
                assert shown.evaluate(OVERFLOW) == 0
                ground = shown.evaluate(SHADE, {"place": "body", "name": "backgroundColor"})
                text = shown.evaluate(SHADE, {"place": ink, "name": "color"})
                assert abs(ground - text) > 70.0
                assert (ground < 60.0) is dark
                assert complaints_there == []
                if pictures := os.environ.get("YAWID_TEST_PICTURES"):
                    path = Path(pictures) / f"{what}_{width}_{'dark' if dark else 'light'}.png"
                    shown.screenshot(path=path, full_page=True)
