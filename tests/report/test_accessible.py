"""axe-core finds nothing on the pages, of any grade, at three widths, on paper and in the dark.

axe-core is a package of npm, which `.ci/run` puts into the tree's root; pages that are in the tree are looked at
by `python tests/report/test_accessible.py reports/*/report.html`, which takes two minutes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import pytest
from devtools import BROWSER, Page, tab

from seqrsm.report.html import render_html

ROOT = Path(__file__).parents[2]
AXE = ROOT / "node_modules" / "axe-core" / "axe.min.js"
WIDTHS = (320, 768, 1280)

pytestmark = [
    pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed"),
    pytest.mark.skipif(not AXE.exists(), reason="no axe-core: npm install --prefix . --no-save axe-core"),
]

RUN = """axe.run(document, {resultTypes: ["violations"]}).then(found => [found.passes.length, found.violations.map(
one => one.impact + " " + one.id + " " + one.nodes.slice(0, 3).map(node => node.html.slice(0, 200)).join(" | "))])"""


def findings(page: Page, file: Path, width: int, *, dark: bool = False) -> list[str]:
    """What axe-core finds on a page whose folded parts are open."""
    page.open(file, width, dark=dark)
    page.run('document.querySelectorAll("details").forEach(one => { one.open = true; })')
    page.run(AXE.read_text(encoding="utf-8") + ";0")
    passed, found = page.run(RUN)
    assert passed > 25, passed
    return [f"{file.name} at {width}: {one}" for one in found]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    with tab(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.mark.parametrize(("name", "widths"), [("simulated", WIDTHS), ("flight", WIDTHS[:1]), ("many", WIDTHS[1:2])])
def test_nothing_is_found_on_a_report(name, widths, request, built, page, tmp_path):
    file = tmp_path / "report.html"
    file.write_text(render_html(built(request.getfixturevalue(name))), encoding="utf-8")
    for width in widths:
        assert findings(page, file, width, dark=width == WIDTHS[1]) == []


def test_what_is_wrong_is_found(flight, built, page, tmp_path):
    """At each grade: an image without words, grey on grey, a table's head without text, a heading out of turn."""
    file, text = tmp_path / "report.html", render_html(built(flight))
    wrong = (
        '<img src="data:,"><p style="color:#999;background:#aaa">x y z</p><table><tr><th></th></tr></table><h5>x</h5>'
    )
    file.write_text(text.replace("</main>", f"{wrong}</main>"), encoding="utf-8")
    found = [" ".join(one.split(": ")[1].split()[:2]) for one in findings(page, file, WIDTHS[-1])]
    assert sorted(found) == [
        "critical image-alt", "minor empty-table-header", "moderate heading-order", "serious color-contrast"
    ]  # fmt: skip


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder, tab(Path(folder), 1200.0) as opened:
        listed = [one for name in sys.argv[1:] for w in WIDTHS for one in findings(opened, Path(name).resolve(), w)]
    print(*listed, sep="\n")
    sys.exit(f"{len(listed)} findings on {len(sys.argv) - 1} pages" if listed else 0)
