"""The ``seqrsm scene`` commands: scenes made and shown."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from seqrsm.cli.console import AsJson, guarded, print_json, say

scene_app = typer.Typer(help="Make and show scenes: elevation and ground cover on a grid.", no_args_is_help=True)

_LARGEST_FIELD_HA = 100.0
"""Fields are seldom larger [ha]: a section of the North American survey has 259, most often in quarters."""


@scene_app.command("import")
@guarded
def scene_import(
    elevation: Annotated[Path, typer.Option(metavar="FILE", help="GeoTIFF of elevations in metres.")],
    cover: Annotated[Path, typer.Option(metavar="FILE", help="Cover codes, GeoTIFF or polygons.")],
    legend: Annotated[Path, typer.Option(metavar="FILE", help="CSV with code, category, note.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Scene to write (.npz).")],
    temperature: Annotated[
        Path | None, typer.Option(metavar="FILE", help="GeoTIFF of ground temperature in kelvin.")
    ] = None,
    moisture: Annotated[Path | None, typer.Option(metavar="FILE", help="GeoTIFF of soil moisture in m3/m3.")] = None,
    parcels: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Fields, as GeoTIFF of field numbers or polygons.")
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Cover codes observed on the ground; only these are scored.")
    ] = None,
    field_m: Annotated[
        float | None, typer.Option(min=0.01, help="Mean field side [m]; larger patches of cover are divided.")
    ] = None,
    cell_m: Annotated[float | None, typer.Option(min=0.0, help="Cell size to resample to [m].")] = None,
    band: Annotated[
        list[str] | None, typer.Option(metavar="LAYER=N", help="Band of a multi-band raster, as in cover=2.")
    ] = None,
    attribute: Annotated[
        list[str] | None, typer.Option(metavar="LAYER=NAME", help="Attribute of polygons, as in cover=crop.")
    ] = None,
) -> None:
    """Build a scene from elevation and cover. On a projected grid in metres."""
    from seqrsm.scene.fields import connected_patches
    from seqrsm.scene.raster import import_scene
    from seqrsm.scene.statistics import field_sizes

    replaced = out.exists()
    named = {"temperature": temperature, "moisture": moisture, "parcels": parcels, "truth": truth}
    scene = import_scene(
        elevation,
        cover,
        legend,
        out,
        cell_m=cell_m,
        field_m=field_m,
        layers={layer: file for layer, file in named.items() if file is not None},
        parts=_parts(band or [], attribute or []),
        name=out.stem,
    )
    words = out.parent / "SCENE.md"
    if replaced and words.exists():
        words.replace(out.parent / "SCENE-of-template.md")
        say(f"{words} describes the previous scene and was renamed SCENE-of-template.md")
    patches = scene.field_id, connected_patches(scene.cover)
    (n, size), (n_before, before) = (field_sizes(one, scene.cover) for one in patches)
    hectares, hectares_before = size * scene.cell_m**2 / 1e4, before * scene.cell_m**2 / 1e4
    say(
        f"wrote {out}: {scene.shape[0]} x {scene.shape[1]} cells of {scene.cell_m:g} m, fields: {n}, median "
        f"{hectares:.3g} ha by area (patches of cover: {n_before}, {hectares_before:.3g} ha)"
    )
    say(scene.provenance)
    if parcels is None and field_m is None and hectares > _LARGEST_FIELD_HA:
        say(
            "warning: each patch of cover is treated as one field, far larger than real fields, which makes scores too "
            "high; give --parcels FILE, or divide them, as with --field-m 150"
        )


def _parts(bands: list[str], attributes: list[str]) -> dict[str, int | str]:
    """Bands of ``--band LAYER=N`` and attributes of ``--attribute LAYER=NAME``."""
    from seqrsm.errors import Problem, SceneError

    out: dict[str, int | str] = {}
    problems = []
    for option, text in [*(("band", text) for text in bands), *(("attribute", text) for text in attributes)]:
        layer, _, part = (word.strip() for word in text.partition("="))
        number = int(part) if part.isdecimal() and len(part) <= 5 else 0
        if not layer or not (number if option == "band" else part):
            remedy = "a number from 1, as in cover=2" if option == "band" else "a name, as in cover=crop"
            remedy = f"Write a layer and {remedy}"
            problems.append(Problem(f"no {option} is named", remedy, field=f"--{option}", value=text))
        out[layer] = number if option == "band" else part
    if problems:
        raise SceneError(*problems)
    return out


@scene_app.command("show")
@guarded
def scene_show(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A scene (.npz).")], as_json: AsJson = False
) -> None:
    """Show the contents of a scene."""
    from seqrsm.cli.show import show_scene
    from seqrsm.scene.file import load_scene
    from seqrsm.scene.statistics import scene_statistics

    scene = load_scene(file)
    statistics = asdict(scene_statistics(scene))
    print_json(statistics) if as_json else show_scene(scene, statistics)
