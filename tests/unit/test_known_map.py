"""A map that is there already: its table as read, its labels as drawn, and what images add, against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from test_cover_measures import IMAGE, KEY, SCENE, image

from seqrsm.errors import UserError
from seqrsm.score import cover
from seqrsm.score.classification import TRUSTS, by_map_alone, named, taught, trusting
from seqrsm.score.cover import FALSE_ALARMS, score_cover, score_evidence
from seqrsm.score.evidence import Evidence, evidence_of
from seqrsm.score.known_map import KnownMap, load_known_map, parts_by_label
from seqrsm.score.utilities import Asked, asked_for

TABLE = "cover,wheat,maize,cloud\nWheat,60,20,20\nCorn,10,30,10\nGrass,1,1,2\nVegetables,0,5,5\n"


def written(folder: Path, text: str = TABLE) -> Path:
    path = folder / "map.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_table_is_read_as_shares_of_each_cover(tmp_path: Path) -> None:
    known = load_known_map(written(tmp_path), ("Corn", "Wheat"))
    assert known.labels == ("wheat", "maize", "cloud")
    np.testing.assert_allclose(known.share, [[0.2, 0.6, 0.2], [0.6, 0.2, 0.2]])
    semicolons = TABLE.replace(",", ";").replace("60", "60,0")  # of a spreadsheet, with decimal commas
    np.testing.assert_array_equal(load_known_map(written(tmp_path, semicolons), ("Corn", "Wheat")).share, known.share)
    with pytest.raises(UserError, match="Use a decimal point"):  # a comma between commas may be anything
        load_known_map(written(tmp_path, TABLE.replace("60", '"60,0"')), ("Corn", "Wheat"))
    written(tmp_path)
    # What was never seen is not ruled out.
    vegetables = load_known_map(tmp_path / "map.csv", ("Vegetables",))
    np.testing.assert_allclose(vegetables.log_share[:, 0], np.log([1e-3, 0.5, 0.5]))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cover,", "kind,", "not a confusion table"),
        (",maize,", ",wheat,", "not a confusion table"),
        ("60,20", "60,many", "csv:2: maize.*must be a number.*many"),
        ("60,20", "60,-20", "csv:2: maize.*0 or more"),
        ("60,20", "60,nan", "csv:2: maize.*must be a number"),
        ("10,30,10", "10,30", "csv:3:.*the row has 3 cells, the header 4"),
        ("10,30,10", "0,0,0", "csv:3:.*no cells"),
        ("Corn", "Wheat", "csv:3:.*given twice"),
        ("Corn", "Maize", "lacks these covers.*Corn"),
    ],
)
def test_a_wrong_table_is_told_with_its_place(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(UserError, match=f"(?s){words}"):
        load_known_map(written(tmp_path, TABLE.replace(old, new, 1)), ("Wheat", "Corn"))


def of(share: list[list[float]], key: int = 0) -> KnownMap:
    return KnownMap(tuple(f"label {k}" for k in range(len(share[0]))), np.array(share), key)


BLURRED = of([[0.7, 0.1, 0.1, 0.1], [0.1, 0.7, 0.1, 0.1], [0.1, 0.1, 0.7, 0.1], [0.1, 0.1, 0.1, 0.7]])
"""Right for 7 fields of 10."""


def test_fields_have_one_label_each_drawn_by_the_table() -> None:
    labels = BLURRED.label_of_fields(SCENE, 3)[SCENE.field_id]
    for field in (0, 17, 399):
        assert np.ptp(labels[SCENE.field_id == field]) == 0
    first = np.unique(SCENE.field_id, return_index=True)[1]
    cover, label = SCENE.cover.ravel()[first], labels.ravel()[first]
    assert np.mean(cover == label) == pytest.approx(0.7, abs=3.5 * math.sqrt(0.21 / len(first)))
    # Another ground has other errors, the same ground the same.
    np.testing.assert_array_equal(BLURRED.label_of_fields(SCENE, 3)[SCENE.field_id], labels)
    assert np.any(replace(BLURRED, key=1).label_of_fields(SCENE, 3)[SCENE.field_id] != labels)


def test_units_are_divided_by_the_labels_of_their_cells() -> None:
    labels = BLURRED.label_of_fields(SCENE, 3)[SCENE.field_id]
    single = np.arange(SCENE.cover.size).reshape(SCENE.cover.shape)
    of, label, counts = parts_by_label(BLURRED, SCENE, single, 3)
    np.testing.assert_array_equal(of, single.ravel())
    np.testing.assert_array_equal(label, labels.ravel())
    np.testing.assert_array_equal(counts.argmax(axis=1), SCENE.cover.ravel())
    one = np.where(SCENE.scored, 5, -1)
    of, label, counts = parts_by_label(BLURRED, SCENE, one, 3)
    np.testing.assert_array_equal((of, label), ([5] * 4, range(4)))
    for k in range(4):
        np.testing.assert_array_equal(counts[k], np.bincount(SCENE.cover[labels == k], minlength=4))
    scored = np.random.default_rng(0).random(SCENE.cover.shape) < 0.5
    _, label, counts = parts_by_label(BLURRED, replace(SCENE, scored=scored), 0 * one, 3)
    np.testing.assert_array_equal(counts.sum(axis=1), np.bincount(labels[scored]))


@pytest.mark.parametrize("by", ["pixel", "neighbourhood", "segment", "field"])
def test_a_map_keeps_its_detail_under_coarse_pixels(by: str) -> None:
    """Fields of 80 m under pixels of 200 m: the map alone was right for 28 % of the ground, where it is for 71."""
    coarse = image(SCENE, resolution=200.0)
    right = BLURRED.label_of_fields(SCENE, KEY["seed"])[SCENE.field_id] == SCENE.cover
    evidence = evidence_of([coarse], SCENE, by=by, known=BLURRED, **KEY)
    by_map = named(evidence, by_map_alone(evidence)).sum(axis=0)
    assert np.trace(by_map) / by_map.sum() == pytest.approx(np.mean(right), abs=0.02)
    # A unit teaches no more for being divided.
    plain = evidence_of([coarse], SCENE, by=by, **KEY)
    held = plain.counts.any(axis=1)
    assert evidence.teaching.sum() == plain.teaching[held].sum()
    assert evidence.counts.sum() == plain.counts.sum()

    def of_tiles(one: Evidence) -> np.ndarray:
        """Cells of each tile, and sums over them of what images show."""
        cells = one.counts.sum(axis=1)
        rows = [cells, *np.where(cells > 0, cells * one.features, 0.0)]
        return np.stack([np.bincount(one.tile, row, len(one.keys)) for row in rows])

    np.testing.assert_allclose(of_tiles(evidence), of_tiles(plain))


def test_what_a_map_adds_to_one_feature_is_the_closed_form() -> None:
    """Two equally likely classes at +-m under unit noise, and a label that is right with probability p.

    The likelihood ratio is 2 m x + logit(p), so that Phi(m + logit(p) / 2m) is right where the label is, and
    Phi(m - logit(p) / 2m) where it is not.
    """
    rng, n, m, p = np.random.default_rng(4), 200_000, 0.6, 0.8
    truth = rng.integers(0, 2, n)
    label = np.where(rng.random(n) < p, truth, 1 - truth)
    counts = np.eye(2, dtype=np.int64)[truth]
    features = rng.standard_normal((1, n)) + m * (2 * truth - 1)
    known = of([[p, 1 - p], [1 - p, p]])
    tile = np.arange(n) // 50
    evidence = Evidence(features, counts, tile, rng.random(n // 50), 0, counts, label=label, log_share=known.log_share)
    shift = math.log(p / (1 - p)) / (2 * m)
    wanted = 100 * (p * norm.cdf(m + shift) + (1 - p) * norm.cdf(m - shift))
    found = score_evidence(evidence, ("a", "b"), Asked("percent_correct"))
    chance = 100 * math.sqrt(0.25 / n)
    assert found.value == pytest.approx(wanted, abs=4 * chance)
    assert found.guess == pytest.approx(100 * p, abs=4 * chance)  # the map alone
    without = score_evidence(replace(evidence, label=None, log_share=np.zeros((1, 1))), ("a", "b"), Asked("kappa"))
    assert without.value == pytest.approx(2 * norm.cdf(m) - 1, abs=8 * chance / 100)
    # Where 5 % of the other class is let through, as many of those that the map calls b are believed as that takes.
    sought = score_evidence(evidence, ("a", "b"), Asked("detection", ("b",)))
    assert sought.guess == pytest.approx(100 * p * FALSE_ALARMS / (1 - p), abs=4 * chance)
    assert sought.value > sought.guess
    # Wrong either way as often, the map alone tells the area well, of which a guess knows nothing.
    assert score_evidence(evidence, ("a", "b"), Asked("area_error", ("b",))).guess < 3.0


def test_images_take_nothing_from_a_map_that_is_better_than_their_classifier_thinks() -> None:
    """Features of heavy tails, for which a Gaussian law is much too sure: what lies far out outvotes a right label."""
    rng, n = np.random.default_rng(4), 40_000
    truth, tile, keys = rng.integers(0, 2, n), np.arange(n) // 50, rng.random(n // 50)
    counts = np.eye(2, dtype=np.int64)[truth]
    features = rng.standard_t(2.5, (6, n)) * np.where(truth == 0, 1.0, 2.0) + 0.3 * truth
    for p in (0.5, 0.7, 0.8, 0.9, 0.99, 1.0):
        known = of([[p, 1 - p], [1 - p, p]])
        label = np.where(rng.random(n) < p, truth, 1 - truth)
        evidence = Evidence(features, counts, tile, keys, 0, counts, label=label, log_share=known.log_share)
        found = score_evidence(evidence, ("a", "b"), Asked("percent_correct"))
        assert found.value > found.guess - 0.01
        assert found.value > found.guess + 1.5 or p > 0.8
        area = score_evidence(evidence, ("a", "b"), Asked("area_error", ("b",)))
        assert area.value < area.guess + 4.0 or p < 0.9
    assert (found.value, area.value) == (100.0, 0.0)


def test_labels_are_trusted_in_one_half_as_far_as_the_other_shows() -> None:
    """Right for all ground of one half, for none in particular in the other: none is judged by what it is tested on."""
    rng, n = np.random.default_rng(4), 40_000
    truth, tile, keys = rng.integers(0, 2, n), np.arange(n) // 50, rng.random(n // 50)
    counts = np.eye(2, dtype=np.int64)[truth]
    features = rng.standard_t(2.5, (6, n)) * np.where(truth == 0, 1.0, 2.0) + 0.3 * truth
    evidence = Evidence(features, counts, tile, keys, 0, counts)
    right = taught(evidence).half[tile] == 0
    label = np.where(right, truth, rng.integers(0, 2, n))
    labelled = replace(evidence, label=label, log_share=of([[0.9, 0.1], [0.1, 0.9]]).log_share)
    told = trusting(labelled, taught(labelled), lambda found: float(np.trace(found))).trust
    assert told[0] == 1.0
    assert told[1] == max(TRUSTS)


@pytest.mark.parametrize("cloud", [0.0, 0.4, 0.8])
def test_images_that_tell_nothing_take_nothing_from_a_map_under_cloud(cloud: float) -> None:
    """The best that can be named: a label where there is one, the commonest cover under cloud."""
    rng, n, share = np.random.default_rng(6), 60_000, np.array([0.6, 0.3, 0.1])
    truth, tile, keys = rng.choice(3, n, p=share), np.arange(n) // 50, rng.random(n // 50)
    right = 0.85
    table = np.full((3, 4), 0.5 * (1.0 - right) * (1.0 - cloud))
    table[range(3), range(3)], table[:, 3] = right * (1.0 - cloud), cloud
    label = (rng.random(n)[:, None] >= np.cumsum(table, axis=1)[truth]).sum(axis=1)
    counts = np.eye(3, dtype=np.int64)[truth]
    evidence = Evidence(
        rng.standard_normal((2, n)), counts, tile, keys, 0, counts, label=label, log_share=of(table.tolist()).log_share
    )
    joint = share[:, None] * table
    best = joint.max(axis=0)
    found = score_evidence(evidence, tuple("abc"), Asked("percent_correct"))
    assert found.value == pytest.approx(100.0 * best.sum(), abs=0.6)
    assert found.value == pytest.approx(found.guess, abs=0.2)
    chance = joint.sum(axis=1) @ np.array([joint[:, joint.argmax(axis=0) == k].sum() for k in range(3)])
    found = score_evidence(evidence, tuple("abc"), Asked("kappa"))
    assert found.value == pytest.approx((best.sum() - chance) / (1.0 - chance), abs=0.01)
    as_b = joint[:, joint.argmax(axis=0) == 1]
    found = score_evidence(evidence, tuple("abc"), Asked("f1", ("b",)))
    assert found.value == pytest.approx(200.0 * as_b[1].sum() / (share[1] + as_b.sum()), abs=1.0)
    wanted = abs(joint[:, joint.argmax(axis=0) == 1].sum() - share[1]) / share[1]
    found = score_evidence(evidence, tuple("abc"), Asked("area_error", ("b",)))
    assert found.value == pytest.approx(100.0 * wanted, abs=3.0)
    by_class = score_evidence(evidence, tuple("abc"), Asked("class_mean_correct"))
    assert by_class.value == pytest.approx(100.0 * (right * (1.0 - cloud) + cloud / 3.0), abs=1.0)


def test_the_map_alone_knows_how_much_of_the_ground_each_cover_has_as_a_guess_does() -> None:
    """Half a, all named 0; four tenths b, a fifth of it named 0; one tenth c, all named 1, which is b by area."""
    truth = np.repeat([0, 1, 1, 2], [500, 80, 320, 100])
    label = np.repeat([0, 0, 1, 1], [500, 80, 320, 100])
    counts = np.eye(3, dtype=np.int64)[truth]
    rng = np.random.default_rng(5)
    features, tile = rng.standard_normal((1, 1000)), rng.integers(0, 40, 1000)
    known = of([[1.0, 0.0], [0.2, 0.8], [0.0, 1.0]])
    evidence = Evidence(features, counts, tile, rng.random(40), 0, counts, label=label, log_share=known.log_share)
    assert score_evidence(evidence, tuple("abc"), Asked("percent_correct")).guess == pytest.approx(82.0)
    assert score_evidence(evidence, tuple("abc"), Asked("class_mean_correct")).guess == pytest.approx(200 / 3)


def test_a_perfect_map_leaves_nothing_to_name_and_clouds_add_nothing() -> None:
    perfect, names = of(np.eye(4).tolist()), ("percent_correct", "class_mean_correct")
    for by in ("pixel", "field"):
        asked = asked_for(f"percent_correct by {by}")
        plain, *equal = (score_cover([IMAGE], SCENE, asked_for(f"{name} by {by}"), **KEY) for name in names)
        clouds, *same = (
            score_cover([IMAGE], SCENE, asked_for(f"{name} by {by}"), known=of([[0.5, 0.5]] * 4), **KEY)
            for name in names
        )
        assert clouds.value == pytest.approx(plain.value, abs=plain.se)  # the areas are known, and nearly alike
        assert (clouds.guess, same[0].value, same[0].guess) == (plain.guess, equal[0].value, equal[0].guess)
        whole = score_cover([IMAGE], SCENE, asked, known=perfect, **KEY)
        assert whole.value > 95.0 if by == "pixel" else whole.value == 100.0
        both = score_cover([IMAGE], SCENE, asked, known=BLURRED, **KEY)
        assert both.guess > plain.guess + 20.0
        assert both.value > max(both.guess, plain.value)


def test_the_map_alone_names_each_unit_by_its_label() -> None:
    told = evidence_of([IMAGE], SCENE, by="field", known=BLURRED, **KEY)
    alone = named(told, by_map_alone(told)).sum(axis=0)
    assert np.trace(alone) == told.counts[np.arange(len(told.label)), told.label].sum()


@pytest.mark.parametrize("measure", ["detection", "area_error", "f1"])
def test_labels_are_trusted_as_far_as_serves_and_not_as_far_as_they_find(monkeypatch, measure: str) -> None:
    """All ground taken for the cover sought finds all of it, and is the worst map; errors are better when smaller."""
    rng, worths = np.random.default_rng(4), []
    counts = np.repeat([[1, 0], [0, 1]], 200, axis=0)
    label = np.where(rng.random(400) < 0.8, counts.argmax(axis=1), 1 - counts.argmax(axis=1))
    says = np.log([[0.8, 0.2], [0.2, 0.8]])
    features, tile = rng.normal(counts.argmax(axis=1), 1.0)[None], np.arange(400) % 20
    evidence = Evidence(features, counts, tile, np.arange(20) / 20, 0, counts, label, says)
    monkeypatch.setattr(cover, "trusting", lambda evidence, by, worth: worths.append(worth) or by)
    score_evidence(evidence, ("a", "b"), Asked(measure, ("b",)))
    (worth,) = worths
    assert worth(np.array([[90, 10], [5, 95]])) > worth(np.array([[0, 100], [0, 100]]))
