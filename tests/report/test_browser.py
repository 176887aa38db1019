"""The page in a real browser: nothing wider than the window at three widths, tables that sort, dark and light."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from seqrsm.report.html import render_html

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
WIDTHS = (360, 768, 1280)

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")

# Every width is a frame of its own: media queries see the frame, and no window manager sets a least width.
HARNESS = """<!DOCTYPE html><meta charset="utf-8"><body style="margin:0">
%(frames)s
<pre id="answer"></pre>
<script>
function inside(element, root) {
  for (var at = element; at && at !== root; at = at.parentElement) {
    var style = at.ownerDocument.defaultView.getComputedStyle(at);
    if (at !== element && style.overflowX !== "visible") { return true; }
    if (style.position === "absolute" || style.visibility === "hidden") { return true; }
  }
  return false;
}
function examine(frame) {
  var page = frame.contentDocument, width = frame.clientWidth, out = [];
  page.querySelectorAll("details").forEach(function (one) { one.open = true; });
  page.body.querySelectorAll("*").forEach(function (element) {
    var box = element.getBoundingClientRect();
    if (box.width > 0 && (box.right > width + 0.5 || box.left < -0.5) && !element.closest("svg")
        && !inside(element, page.body)) {
      out.push(element.tagName + " " + element.className + " " + box.left.toFixed(0) + " to " + box.right.toFixed(0)
               + ": " + element.textContent.slice(0, 60));
    }
  });
  var small = Array.from(page.querySelectorAll("svg")).filter(function (drawing) {
    return drawing.getBoundingClientRect().width < Math.min(width - 80, 250);
  }).length;
  return {width: width, scroll: page.documentElement.scrollWidth, outside: out.slice(0, 10), small: small,
          paper: frame.contentWindow.getComputedStyle(page.body).backgroundColor,
          ink: frame.contentWindow.getComputedStyle(page.body).color};
}
function sorts(frame) {
  var tables = frame.contentDocument.querySelectorAll("table[data-sortable]"), out = [];
  tables.forEach(function (table) {
    table.querySelectorAll("thead button").forEach(function (button, column) {
      ["ascending", "descending"].forEach(function (direction) {
        button.click();
        var cells = Array.from(table.tBodies[0].rows).map(function (row) { return row.cells[column]; });
        var numbers = cells.filter(function (cell) { return cell.dataset.value !== undefined; })
                           .map(function (cell) { return Number(cell.dataset.value); });
        var sorted = numbers.slice().sort(function (a, b) { return direction === "ascending" ? a - b : b - a; });
        if (button.parentElement.getAttribute("aria-sort") !== direction
            || JSON.stringify(numbers) !== JSON.stringify(sorted)) {
          out.push(button.textContent + " " + direction);
        }
      });
    });
  });
  return {tables: tables.length, wrong: out};
}
window.addEventListener("load", function () {
  var frames = Array.from(document.querySelectorAll("iframe"));
  var answer = {pages: frames.map(examine), sorts: sorts(frames[frames.length - 1])};
  document.getElementById("answer").textContent = JSON.stringify(answer);
});
</script>"""


def in_browser(page: str, folder: Path, *flags: str) -> dict:
    """What the browser finds on a page at every width."""
    assert BROWSER is not None
    source = html.escape(page)
    frames = "\n".join(f'<iframe style="border:0;width:{w}px;height:900px" srcdoc="{source}"></iframe>' for w in WIDTHS)
    harness = folder / "harness.html"
    harness.write_text(HARNESS % {"frames": frames}, encoding="utf-8")
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
        f"--user-data-dir={folder / 'profile'}", "--window-size=1400,1000", "--dump-dom", *flags, harness.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout, re.S)
    assert found is not None, done.stderr[-2000:]
    assert found[1], done.stderr[-2000:]
    return json.loads(html.unescape(found[1]))


@pytest.mark.parametrize("name", ["simulated", "flight", "many"])
def test_nothing_is_wider_than_the_window_and_tables_sort(name, request, built, tmp_path):
    page = render_html(built(request.getfixturevalue(name)))
    found = in_browser(page, tmp_path)
    assert [one["width"] for one in found["pages"]] == list(WIDTHS)
    for one in found["pages"]:
        assert one["scroll"] <= one["width"], one
        assert one["outside"] == [], one
        assert one["small"] == 0, one
    assert found["sorts"]["tables"] >= 1
    assert found["sorts"]["wrong"] == []


def luminance(colour: str) -> float:
    """Relative luminance of WCAG 2.2 of a colour such as "rgb(1, 2, 3)"."""
    channels = [int(part) / 255.0 for part in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_dark_and_light_follow_the_reader(flight, built, tmp_path):
    page = render_html(built(flight))
    (tmp_path / "light").mkdir()
    (tmp_path / "dark").mkdir()
    light = in_browser(page, tmp_path / "light", "--blink-settings=preferredColorScheme=1")["pages"][0]
    dark = in_browser(page, tmp_path / "dark", "--blink-settings=preferredColorScheme=0")["pages"][0]
    assert luminance(light["paper"]) > 0.9
    assert luminance(dark["paper"]) < 0.05
    for shown in (light, dark):
        bright, dim = sorted((luminance(shown["paper"]), luminance(shown["ink"])), reverse=True)
        assert (bright + 0.05) / (dim + 0.05) > 7.0  # WCAG AAA


def test_the_harness_finds_what_is_too_wide(flight, built, tmp_path):
    page = render_html(built(flight)).replace("<footer>", '<footer><div style="width:500px">x</div>')
    found = in_browser(page, tmp_path)["pages"]
    assert found[0]["scroll"] >= 500
    assert any("DIV" in text for text in found[0]["outside"])
    assert found[1]["outside"] == []


def test_paper_from_the_page_holds_what_is_folded(simulated, built, tmp_path):
    """Every cell of the folded table of runs is on the printed pages; sliders are not."""
    from pypdf import PdfReader
    from report_texts import squeezed

    assert BROWSER is not None
    report = built(simulated)
    (tmp_path / "page.html").write_text(render_html(report), encoding="utf-8")
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer",
        f"--user-data-dir={tmp_path / 'profile'}", f"--print-to-pdf={tmp_path / 'page.pdf'}",
        (tmp_path / "page.html").as_uri(),
    ]  # fmt: skip
    subprocess.run(command, capture_output=True, timeout=120, check=True)
    printed = squeezed("".join(page.extract_text() for page in PdfReader(tmp_path / "page.pdf").pages))
    runs = next(one for one in report.sections[-1].sections if one.key == "runs").blocks[-1].blocks[0]
    for row in runs.rows:
        assert squeezed("".join(cell.text for cell in row)) in printed, row
    assert "Tryothersettings" not in printed
