"""Build ``scene.npz`` of this campaign from the source rasters: always the same bytes.

    python build_scene.py SOURCE.npz [scene.npz]

``SOURCE.npz`` holds ``elevation_cm`` (int16, -32768 no data), ``cover`` (uint8: 0 no data, 1 arable, 2 infrastructure,
3 forest, 4 grass, 5 water), ``parcel`` (uint16, 10 = field cell without parcel id), ``cell_m``, ``epsg``, ``bounds``;
see ``SCENE.md`` for where the rasters come from and for every choice made here.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seqrsm.arrays import AnyArray, BoolArray
from seqrsm.scene.fields import connected_patches, draw_index, voronoi_labels
from seqrsm.scene.file import save_scene
from seqrsm.scene.scene import NO_COVER, Scene

SEED = 1979
CROP_SHARES = {"Wheat": 0.30, "Corn": 0.25, "Oats": 0.10, "Vegetables": 0.20, "Forage": 0.10, "Bareground": 0.05}
OTHER_COVER = {2: "Settlement", 3: "Trees", 4: "Grass", 5: "Water"}
ARABLE, NO_PARCEL_ID = 1, 10
FIELD_SPACING_M = 160.0  # mean drawn field 2.6 ha
PATCH_SPACING_M = 140.0  # forest, grass, infrastructure and water in pieces of 2 ha on average
LICENCE = (
    "Source rasters: DOV-Vlaanderen/saga-watem (LGPL-3.0), test data 'langegracht'; elevation from the Digital Height "
    "Model of Flanders II, free open data of the Flemish government. Crops drawn by seqrsm. See SCENE.md."
)
PROVENANCE = (
    "Built by build_scene.py from dhmvi_5m, Landgebruik_def and prc of DOV-Vlaanderen/saga-watem commit 8ed1b20a. "
    f"Parcels, land use and elevation are real; the crop of each parcel is drawn (seed {SEED}); where the source has "
    "no parcel id the field boundaries are drawn too and scored is False."
)


def build(source: Mapping[str, AnyArray]) -> Scene:
    """Scene of the source rasters."""
    use, parcel = source["cover"], source["parcel"].astype(np.int64)
    rows, cols = use.shape
    cell_m = float(source["cell_m"])
    elevation = (source["elevation_cm"].astype(np.float64) / 100.0).astype(np.float32)
    elevation[source["elevation_cm"] == -32768] = np.nan

    arable = use == ARABLE
    drawn = arable & ((parcel == NO_PARCEL_ID) | (parcel == 0))
    field_piece = voronoi_labels(rows, cols, round(FIELD_SPACING_M / cell_m), seed=SEED)
    patch_piece = voronoi_labels(rows, cols, round(PATCH_SPACING_M / cell_m), seed=SEED + 1)
    unit = np.where(drawn, field_piece, np.where(arable, parcel, patch_piece))

    crop_key = np.where(drawn, 1_000_000 + field_piece, parcel)
    crop = draw_index(crop_key, list(CROP_SHARES.values()), seed=SEED + 2)
    categories = (*CROP_SHARES, *OTHER_COVER.values())
    cover = np.full(use.shape, NO_COVER, dtype=np.uint8)
    cover[arable] = crop[arable]
    for code, name in OTHER_COVER.items():
        cover[use == code] = categories.index(name)

    known: BoolArray = np.isfinite(elevation) & (cover != NO_COVER)
    left, bottom, right, top = (float(edge) for edge in source["bounds"])
    drawn_note = "drawn for each parcel, not observed"
    return Scene(
        elevation_m=elevation,
        cover=cover,
        categories=categories,
        field_id=connected_patches(cover, drawn, unit),
        scored=known & ~drawn,
        cell_m=cell_m,
        epsg=int(source["epsg"]),
        bounds=(left, bottom, right, top),
        name="Langegracht, Flanders",
        licence=LICENCE,
        provenance=PROVENANCE,
        category_notes={
            **dict.fromkeys(CROP_SHARES, drawn_note),
            "Settlement": "the source's infrastructure: roads, yards and buildings together",
        },
    )


def main() -> None:
    """Read the source named on the command line and write the scene."""
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    target = Path(sys.argv[2]) if len(sys.argv) == 3 else Path(__file__).with_name("scene.npz")
    with np.load(sys.argv[1], allow_pickle=False) as archive:
        scene = build({name: archive[name] for name in archive.files})
    save_scene(scene, target)
    print(f"{target}: {scene.shape[0]} x {scene.shape[1]} cells, {scene.n_fields} fields")


if __name__ == "__main__":
    main()
