"""Build ``scene.npz`` of this campaign from the source rasters: always the same bytes.

    python build_scene.py SOURCE.npz [scene.npz]

``SOURCE.npz`` holds ``elevation_cm`` (int16, -32768 no data), ``cover`` (uint8: 0 no data, 1 developed, 2 agriculture,
3 herbaceous, 4 shrubland, 5 forest, 6 water, 7 sediment), ``cell_m``, ``epsg``, ``bounds``; see ``SCENE.md`` for where
the rasters come from and for every choice made here.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seqrsm.arrays import AnyArray
from seqrsm.scene.fields import connected_patches, voronoi_labels
from seqrsm.scene.file import save_scene
from seqrsm.scene.scene import NO_COVER, Scene

SEED = 1979
COVER = {1: "Settlement", 2: "Hay", 3: "Grass", 4: "Scrub", 5: "Trees", 6: "Water", 7: "Gravel"}
SEDIMENT = 7
PATCH_SPACING_M = 450.0  # covers in pieces of 20 ha on average
LICENCE = (
    "CC BY-SA 3.0: GRASS GIS North Carolina data set, as shipped in MiKatt/openSTARS. Acknowledge the GRASS "
    "Development Team, Mitasova and Neteler. See SCENE.md."
)
PROVENANCE = (
    "Built by build_scene.py from elev_ned_30m and landuse_r of MiKatt/openSTARS commit 09b36612 (inst/extdata/nc). "
    f"Elevation and cover are real; patch boundaries inside one cover are drawn (seed {SEED})."
)


def build(source: Mapping[str, AnyArray]) -> Scene:
    """Scene of the source rasters."""
    use = source["cover"]
    rows, cols = use.shape
    cell_m = float(source["cell_m"])
    elevation = (source["elevation_cm"].astype(np.float64) / 100.0).astype(np.float32)
    elevation[source["elevation_cm"] == -32768] = np.nan
    categories = tuple(COVER.values())
    cover = np.full(use.shape, NO_COVER, dtype=np.uint8)
    for code, name in COVER.items():
        cover[use == code] = categories.index(name)
    piece = voronoi_labels(rows, cols, round(PATCH_SPACING_M / cell_m), seed=SEED)
    left, bottom, right, top = (float(edge) for edge in source["bounds"])
    return Scene(
        elevation_m=elevation,
        cover=cover,
        categories=categories,
        field_id=connected_patches(cover, piece),
        scored=np.isfinite(elevation) & (cover != NO_COVER) & (use != SEDIMENT),
        cell_m=cell_m,
        epsg=int(source["epsg"]),
        bounds=(left, bottom, right, top),
        name="Wake County, North Carolina",
        licence=LICENCE,
        provenance=PROVENANCE,
        category_notes={
            "Settlement": "the source's developed land: roofs, roads and lawns together",
            "Hay": "the source's agriculture; the crop is not known",
            "Gravel": "the source's sediment, 0.1 % of the site, not scored",
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
