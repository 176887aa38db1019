"""A map of the cover that is there already, by how it errs: what new images add to it is then what a score tells.

Such a map is given by its confusion table, as its validation found it: a row for each cover of the ground, a column for
each label of the map, in cells, counts or per cent. A label may tell nothing, such as ``cloud``. The map gives each
field one label, rightly or wrongly; the classifier knows the table, and weighs a unit's label by it beside what images
show, as far as `seqrsm.score.classification` finds it to be trusted. A classifier that looks at the map alone is the
score's floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seqrsm.arrays import AnyArray, FloatArray, IntArray
from seqrsm.errors import Problem, SceneError
from seqrsm.rng import generator
from seqrsm.scene.layers import categories_of_fields
from seqrsm.scene.scene import Scene
from seqrsm.score.table import read_table, table_text

_LEAST_SHARE = 1e-3  # of a label that the table never saw with a cover: no table is large enough to rule it out
_NUMBERS = "Give counts or percent, 0 or more."


@dataclass(frozen=True, slots=True, eq=False)
class KnownMap:
    """How a map names the ground."""

    labels: tuple[str, ...]

    share: FloatArray
    """(n_classes, n_labels): share of each cover's ground that has each label; rows sum to 1."""
    key: int = 0
    """Of what it names wrongly: the same for all images of one ground."""

    @property
    def log_share(self) -> FloatArray:
        """What each label says for each class, (n_labels, n_classes): natural logarithm of the share."""
        return np.asarray(np.log(np.maximum(self.share, _LEAST_SHARE)).T)

    def label_of_fields(self, scene: Scene, seed: int) -> IntArray:
        """Label (n_fields,) that it gives each field of a scene."""
        cover = categories_of_fields(scene).astype(np.int64)
        reached = np.cumsum(self.share, axis=1)[np.where(cover < len(self.share), cover, 0)]
        drawn = generator(seed, self.key, "known map").random(len(cover))
        return np.asarray(np.minimum(np.sum(drawn[:, None] >= reached, axis=1), len(self.labels) - 1))


def load_known_map(path: str | Path, categories: Sequence[str]) -> KnownMap:
    """Read a map's confusion table: ``cover`` and a column for each label, separated as scores may be.

    ``categories`` are the covers of the scene: the table must have a row for each, and may have more.

    Raises
    ------
    SceneError, ScoresFileError
        Every cell that is no share, covers that are missing, given twice or without any ground.
    """
    text, file = table_text(path), str(path)
    table = read_table(text.name, text.data, lambda cell: cell.strip().lower() == "cover")
    header = [cell.strip() for cell in table.header]
    place = next((i for i, cell in enumerate(header) if cell.lower() == "cover"), len(header))
    labels = [*header[:place], *header[place + 1 :]]
    if place == len(header) or len(labels) < 2 or "" in labels or len(set(labels)) < len(labels):
        remedy = "Give it the header: cover, and two or more labels."
        raise SceneError("this is not a confusion table", remedy, file=file, line=table.header_line)
    problems: list[Problem] = []
    rows: dict[str, FloatArray] = {}
    for line, cells in table.rows:
        given = list(cells)
        cover = given.pop(place).strip() if place < len(cells) else ""
        row = np.array([_number(cell, table.delimiter) for cell in given])
        for label, cell, share in zip(labels, given, row, strict=False):
            if not 0.0 <= share < np.inf:
                remedy = "Use a decimal point." if "," in cell else _NUMBERS
                problems.append(Problem("a share must be a number", remedy, file, line, label, cell))
        if len(cells) != len(header):
            wrong = f"the row has {len(cells)} cells, the header {len(header)}"
            problems.append(Problem(wrong, "Give one to each label.", file, line))
        elif cover in rows:
            problems.append(Problem("a cover is given twice", "Keep one.", file, line, "cover", cover))
        elif not row.any():
            problems.append(Problem("a cover has no cells", _NUMBERS, file, line, "cover", cover))
        rows[cover] = row
    listed, missing = (", ".join(names) for names in (rows, [name for name in categories if name not in rows]))
    if missing and not problems:
        wrong, remedy = "the map lacks these covers of the scene", f"Add a row for each; the table has {listed}."
        problems.append(Problem(wrong, remedy, file, table.header_line, "cover", missing))
    if problems:
        raise SceneError(*problems)
    return KnownMap(tuple(labels), np.array([rows[name] / rows[name].sum() for name in categories]))


def _number(text: str, delimiter: str) -> float:
    """A number, whose decimals may have a comma where commas do not separate cells; nan if it is none."""
    try:
        return float(text if delimiter == "," else text.replace(",", "."))
    except ValueError:
        return np.nan


def parts_by_label(known: KnownMap, scene: Scene, unit: AnyArray, seed: int) -> tuple[AnyArray, IntArray, AnyArray]:
    """Parts of units of ground whose scored cells have one label: unit (n,), label (n,), cells (n, n_classes).

    The map keeps its own detail under pixels that are coarser, each cell the label of its field. ``unit`` (rows,
    columns): unit of each cell, -1 for none.
    """
    cells = np.flatnonzero((unit >= 0) & scene.scored & (scene.cover < len(known.share)))
    label = known.label_of_fields(scene, seed)[scene.field_id.ravel()[cells]]
    code = unit.ravel()[cells].astype(np.int64) * len(known.labels) + label
    used = np.zeros((int(unit.max()) + 1) * len(known.labels), dtype=np.bool_)  # np.unique takes five times as long
    used[code] = True
    codes, part = np.flatnonzero(used), (np.cumsum(used, dtype=np.int32) - 1)[code]
    n_classes = len(known.share)
    counts = np.bincount(part * n_classes + scene.cover.ravel()[cells], minlength=len(codes) * n_classes)
    return *np.divmod(codes, len(known.labels)), counts.reshape(-1, n_classes).astype(np.int32)
