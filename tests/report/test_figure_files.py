"""Figures as files: four forms of each, the numbers behind them, the same bytes every time."""

from __future__ import annotations

import csv
import io
import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from pypdf import PdfReader
from report_dossiers import truth_score, two_uses

from seqrsm.design.constraints import Constraint
from seqrsm.design.region import Region
from seqrsm.report.content import build_report
from seqrsm.report.figures import drawing as drawn
from seqrsm.report.figures.drawing import PANEL_WIDTH_IN, draw, legend_above, svg_for_html, tell
from seqrsm.report.figures.files import named_panels, write_figures
from seqrsm.report.figures.optimum import _label_style, contour_data
from seqrsm.report.figures.surfaces import surface
from seqrsm.report.wording import slug


@pytest.fixture(scope="module")
def folder(simulated, built, tmp_path_factory):
    made = tmp_path_factory.mktemp("figures")
    write_figures(built(simulated), made)
    return made


def table(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_picture_has_four_files_and_a_caption(folder):
    names = [row["file"] for row in table(folder / "captions.csv")]
    assert len(names) == len(set(names))
    assert {"surface-depression-angle-against-frequency", "slice-polarization", "intervals"} <= set(names)
    assert {"image-at-the-optimum-hv", "ground-truth", "history-of-half-width"} <= set(names)
    expected = {f"{name}{suffix}" for name in names for suffix in (".svg", ".pdf", ".png", ".csv")} | {"captions.csv"}
    assert {path.name for path in folder.iterdir()} == expected
    assert all(row["what it shows"] and row["caption of its figure"] for row in table(folder / "captions.csv"))


def test_a_map_of_covers_can_be_read_without_the_report(simulated, folder):
    """Its table names covers, and its caption the colours of the bitmap."""
    captions = {row["file"]: row["caption of its figure"] for row in table(folder / "captions.csv")}
    colours = dict(re.findall(r"(#[0-9a-f]{6}): ([a-z ]+)\.", captions["ground-truth"]))
    assert sorted(colours.values()) == sorted(simulated.scene.categories)
    rows = [list(row.values())[1:] for row in table(folder / "ground-truth.csv")]
    assert {name for row in rows for name in row} == {*simulated.scene.categories, ""}
    with Image.open(folder / "ground-truth.png") as picture:
        image = np.asarray(picture.convert("RGB"))
    lowest = [name for name in rows[-1] if name]
    seen = {f"#{r:02x}{g:02x}{b:02x}" for r, g, b in image.reshape(-1, 3)}
    assert {colour for colour, name in colours.items() if name in lowest} <= seen


def test_settings_on_a_constraint_are_drawn_as_allowed(simulated):
    """The optimum often lies on one; over the other factors all of a contour plot is then within rounding of it."""
    analysis = simulated.analyses[0]
    at = analysis.optimum.settings["looks"]
    for bound, allowed in ((at * (1.0 - 1e-15), True), (at * (1.0 - 1e-6), False)):
        region = Region(analysis.region.factors, (Constraint(f"looks <= {bound!r}"),))
        cut = replace(analysis, fitted=replace(analysis.fitted, region=region))
        x, y = (region.names.index(name) for name in ("frequency", "depression_angle"))
        shown = surface(cut, x, y)
        assert np.all((shown.slack >= 0.0) == allowed)
        assert {row[4] for row in contour_data(cut, shown).rows[: shown.slack.size]} == {"yes" if allowed else "no"}


def test_files_are_what_their_names_say(folder):
    from xml.etree import ElementTree

    for path in folder.glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")
    with Image.open(folder / "slice-frequency.png") as image:
        assert image.width > 800
    page = PdfReader(folder / "slice-frequency.pdf")
    assert len(page.pages) == 1
    assert page.metadata.creation_date is None
    assert abs(float(page.pages[0].mediabox[2]) / 72 - PANEL_WIDTH_IN) < 0.05


def test_slice_data_are_the_model(simulated, folder):
    """The polynomial of the slice, refitted to the CSV, is that of the coefficients."""
    analysis = simulated.analyses[0]
    rows = [row for row in table(folder / "slice-frequency.csv") if row["layer"] == "fitted"]
    x = np.array([float(row["frequency [GHz]"]) for row in rows])
    y = np.array([float(row["score [percent]"]) for row in rows])
    coded = 2.0 * np.log(x / 1.2) / np.log(17.0 / 1.2) - 1.0
    square = np.polyfit(coded, y, 2)[0]
    assert square == pytest.approx(analysis.fit.estimate[list(analysis.fit.names).index("frequency^2")], rel=1e-6)
    runs = [row for row in table(folder / "slice-frequency.csv") if row["layer"].startswith("run")]
    frequency = analysis.region.factors[0].decode(analysis.data.points[:, 0])
    allowed = frequency <= 20 - analysis.optimum.settings["looks"]
    assert [int(row["run"]) for row in runs] == analysis.data.run_ids[allowed].tolist()


def test_contour_data_hold_the_surface_the_runs_and_the_optimum(simulated, folder):
    rows = table(folder / "surface-depression-angle-against-frequency.csv")
    layers = [row["layer"] for row in rows]
    assert layers.count("fitted mean") == 41 * 41
    assert layers.count("run") == simulated.analyses[0].fit.n_runs
    (best,) = [row for row in rows if row["layer"] == "recommended"]
    assert float(best["score [percent]"]) == pytest.approx(simulated.analyses[0].optimum.mean)
    # the constraint looks <= 20 - frequency at the optimal number of looks
    looks = simulated.analyses[0].optimum.settings["looks"]
    for row in rows[: 41 * 41 : 37]:
        assert (row["allowed"] == "yes") == (float(row["frequency [GHz]"]) <= 20 - looks + 1e-9)
    assert truth_score(simulated.analyses[0].optimum.point[None, :])[0] == pytest.approx(
        float(best["score [percent]"]), abs=4.0
    )


def test_picture_data_are_the_pixels(folder):
    with (folder / "image-at-the-optimum-hv.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    grey = np.array([[float(cell) for cell in row[1:]] for row in rows[1:]])
    with Image.open(folder / "image-at-the-optimum-hv.png") as image:
        assert np.array_equal(np.asarray(image)[: len(grey)], grey)


def test_same_report_same_files(simulated, folder, tmp_path):
    report = build_report(simulated)
    only = {name for name, *_ in named_panels(report) if name in ("slice-frequency", "ground-truth")}
    write_figures(report, tmp_path)
    for name in only:
        for suffix in (".svg", ".pdf", ".png", ".csv"):
            assert (tmp_path / f"{name}{suffix}").read_bytes() == (folder / f"{name}{suffix}").read_bytes()


def test_several_applications_have_their_own_names(flight):
    names = [name for name, *_ in named_panels(build_report(two_uses(flight)))]
    assert len(names) == len(set(names))
    assert "application-drainage-slice-film" in names
    assert "application-other-use-slice-film" in names


def test_slug_is_a_safe_file_name():
    assert slug("../a b/Ünïcode\\x\n") == "a-b-n-code-x"
    assert slug("///") == "x"


def test_marks_tell_their_run_without_any_script():
    def paint(axes):
        tell(axes.scatter([1, 2, 3], [3, 1, 2], clip_on=False), ["run 1 <b>", 'run 2 & "c"', "run 3"])
        tell(axes.scatter([1], [1]), ["a", "b"])  # the number does not match: no texts, no harm

    drawing = draw(paint)
    for svg in (drawing, svg_for_html(drawing, "p-")):
        assert "<title>run 1 &lt;b&gt;</title>" in svg
        assert svg.count("<title>") == 3
        assert "tips:" not in svg
    from xml.etree import ElementTree

    ElementTree.parse(io.StringIO(drawing))


def test_signs_that_no_font_has_are_told_once_and_in_our_words(recwarn) -> None:
    drawn._warn_once.cache_clear()
    for _ in range(2):
        draw(lambda axes: axes.set_xlabel("\ue000\ue001"))
    assert [str(one.message) for one in recwarn] == [drawn.NO_FONT]


@pytest.mark.skipif(len(drawn._families()) == 1, reason="no font for Chinese")
def test_chinese_is_drawn_by_a_font_that_has_it(recwarn) -> None:
    drawn._warn_once.cache_clear()
    water, flat = (draw(lambda axes, sign=sign: axes.set_xlabel(sign)) for sign in "\u6c34\u5e73")
    assert water != flat
    assert not list(recwarn)


@pytest.mark.parametrize(
    "labels",
    [
        ["HH", "HH+HV", "HH+HV+VV+phase"],
        ["H", "V"],
        ["HH+HV", "VV+VH", "HH+HV+VV+phase"],
        ["HH+HV", "VV+VH"],
        ["L", "C", "L+C"],
        ["HH", "VV", "HH+VV", "RH+RV"],
        ["HH", "HV", "VV", "HH+HV", "HH+VV", "HV+VV", "HH+HV+VV", "FULLPOL"],
    ],
)
def test_names_of_levels_below_an_axis_do_not_run_into_each_other(labels):
    boxes = []

    def paint(axes):
        axes.set_xticks(np.arange(len(labels)), labels, **_label_style(labels))
        axes.set_xlim(-0.6, len(labels) - 0.4)
        axes.set_ylabel("score [percent]")
        axes.figure.draw_without_rendering()
        boxes.extend(label.get_window_extent() for label in axes.get_xticklabels() if label.get_rotation() == 0.0)

    draw(paint)
    assert all(right.x0 - left.x1 >= 1.0 for left, right in itertools.pairwise(boxes))


def test_a_legend_above_the_axes_hides_no_line():
    boxes = []

    def paint(axes):
        for name in ("half-width", "target", "noise floor"):
            axes.axhline(1.0, label=name)
        legend_above(axes)
        axes.figure.draw_without_rendering()
        boxes.extend((axes.get_window_extent(), axes.get_legend().get_window_extent(), axes.figure.bbox))

    draw(paint)
    plot, legend, whole = boxes
    assert plot.y1 <= legend.y0
    assert whole.x0 <= legend.x0 < legend.x1 <= whole.x1
