"""The report in a real browser, at the widths of a desk and a phone: nothing overflows, no picture is missing."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from rkfbench.report.page import write_report
from rkfbench.report.render import render
from tests.report import fakes

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (apt-get install chromium)")

# A window cannot be made as narrow as a phone, a frame can. The page reports to the frame around it.
FRAME = """<!DOCTYPE html><title>frame</title><iframe src="page.html" width="{width}" height="2000" style="border:0">
</iframe><pre></pre><script>onmessage = (e) => document.querySelector("pre").textContent = e.data</script>"""
PROBE = """<script>onload = () => {
  const all = [...document.querySelectorAll("body *")];
  const loose = all.filter(e => !e.closest(".scroll *, svg svg, [hidden]") && e.getBoundingClientRect().width > 0);
  parent.postMessage(JSON.stringify({
    inner: innerWidth, scroll: document.documentElement.scrollWidth,
    wide: loose.filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + " " + e.className),
    images: [...document.images].map(i => i.complete && i.naturalWidth > 0),
    regions: document.querySelectorAll("svg.plot rect.region").length,
  }), "*");
}</script>"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("page")
    fakes.write_results(place / "fake")
    render(place / "fake")
    write_report([place / "fake"], place)
    html = (place / "report.html").read_text(encoding="utf-8").replace("<details", "<details open")
    (place / "page.html").write_text(html.replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
    return place


@pytest.mark.parametrize("width", [1280, 390])
def test_the_page_fits_its_window_shows_its_pictures_and_logs_no_error(place: Path, width: int) -> None:
    (place / "frame.html").write_text(FRAME.format(width=width))
    seen, console = in_browser(place / "frame.html", place / f"profile-{width}")
    assert seen["inner"] == width
    assert seen["wide"] == []
    assert seen["scroll"] <= width
    assert seen["images"] == [True] * 4
    assert seen["regions"] == 4
    assert console == []


def in_browser(path: Path, profile: Path) -> tuple[dict[str, Any], list[str]]:
    """What the probe in the page reports, and what went to the console."""
    assert CHROMIUM is not None
    flags = ["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", f"--user-data-dir={profile}"]
    command = [CHROMIUM, *flags, "--window-size=1400,2000", "--virtual-time-budget=5000", "--dump-dom", path.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    report = re.search(r"<pre>(.*?)</pre>", done.stdout, re.DOTALL)
    assert report, done.stdout[-500:]
    text = report[1].replace("&gt;", ">").replace("&lt;", "<").replace("&amp;", "&")
    return json.loads(text), [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
