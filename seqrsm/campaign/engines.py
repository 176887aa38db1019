"""The two engines behind one face: how settings become a sensor, an image, and what is kept with a score."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from seqrsm.errors import SpecError, UserError
from seqrsm.own_code import contained, file_of, import_remedy, not_writable, own_function
from seqrsm.scattering.emissivity import load_emissivity_table
from seqrsm.scattering.sigma0 import Sigma0Table, load_sigma0_table
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import UtilityScore
from seqrsm.score.known_map import KnownMap
from seqrsm.score.pixels import Image
from seqrsm.score.utilities import UTILITIES, asked_for
from seqrsm.sensor import radar, radiometer
from seqrsm.sensor.hardware import Limit, limits
from seqrsm.sensor.parameters import Parameter
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.scan import LARGE_ANTENNA
from seqrsm.sensor.sets import SENSORS
from seqrsm.simulate.radar.frame import RadarFrame, make_frame
from seqrsm.simulate.radar.occasion import look_up
from seqrsm.simulate.radar.psm import (
    SATURATED,
    TOO_WEAK,
    blind_channels,
    finer_than_cells,
    simulate_radar,
    tops_counted_twice,
)
from seqrsm.simulate.radar.receiver import named_function, transfer_function
from seqrsm.simulate.radar.result import RadarImage
from seqrsm.simulate.radar.targets import CulturalTarget, check_targets, load_targets
from seqrsm.simulate.radiometer.prm import check_radiometer, simulate_radiometer

Settings = Mapping[str, float | str]
CANNOT_BE_BUILT: Final = "this radar cannot be built"
NOT_TO_BE_USED: Final = (CANNOT_BE_BUILT, TOO_WEAK, SATURATED, LARGE_ANTENNA)
"""How those notes on a sensor begin that no recommendation may go without."""


@dataclass(frozen=True, slots=True)
class Engine:
    """One of the report's two models."""

    configure: Callable[[Settings, Settings], Any]
    """Settings and fixed parameters -> sensor; raises ConfigurationError."""
    table: Callable[..., Any]
    """Path, or "" for the shipped one, and whether it needs rows of the engine -> table of sigma0 or emissivity, read
    once per process."""
    simulate: Callable[..., Any]
    """Scene, sensor, table, and by name seed, run id and visit -> image."""
    examine: Callable[[Scene, Any, Any, float | None], tuple[str, ...]]
    """Scene, sensor, table and day of the year -> what the combination of parameters does, each note as "kind: what";
    raises UserError where the sensor cannot image the scene, without imaging it."""
    detail_m: Callable[[Any], float]
    """Sensor -> side of what it tells apart [m]; 0 where the data base must stay as it is."""
    parameters: Mapping[str, Parameter]
    """The sensor's, by their names in ``campaign.toml``."""
    threads: bool = False
    """Whether `simulate` takes a number of threads."""
    masks: tuple[str, ...] = ()
    """Masks of the scene's grid that its images have."""

    @property
    def files(self) -> tuple[str, ...]:
        """Sensor parameters that name a file; in ``campaign.toml`` its path is from the campaign's folder."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.kind == "file")

    @property
    def functions(self) -> tuple[str, ...]:
        """Those that may name a function of the user's, whose module may lie in the campaign's folder."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.kind == "function")


@lru_cache(maxsize=16)
def _loaded(load: Callable[..., Any], path: str, modified_ns: int, *more: Any) -> Any:
    del modified_ns  # part of the key: an edited file is read again
    return load(path or None, *more)


def loaded(load: Callable[..., Any], path: str, *more: Any) -> Any:
    """What ``load`` makes of a file, "" for the shipped one, and of ``more``; once as long as the file stays."""
    modified_ns = Path(path).stat().st_mtime_ns if path and Path(path).exists() else 0
    return _loaded(load, path, modified_ns, *more)


def _radar_image(scene: Scene, sensor: RadarConfiguration, table: Sigma0Table, **how: Any) -> RadarImage:
    return simulate_radar(scene, sensor, table, targets=_targets(sensor.targets_file), **how)


def _targets(path: str) -> tuple[CulturalTarget, ...]:
    found: tuple[CulturalTarget, ...] = loaded(load_targets, path) if path else ()
    return found


def _examine_radar(scene: Scene, sensor: RadarConfiguration, table: Sigma0Table, day: float | None) -> tuple[str, ...]:
    frame = make_frame(scene, replace(sensor, texture_db=0.0), "float32")  # nothing here asks for parts of fields
    transfer_function(sensor, 1.0)
    if sensor.processing:
        named_function("processing", sensor.processing)
    check_targets(_targets(sensor.targets_file), scene.shape)
    # Whatever wind and moisture a run draws lies between these.
    for state in ((sensor.soil_moisture_low, sensor.wind_low_m_s), (sensor.soil_moisture_high, sensor.wind_high_m_s)):
        lookups = look_up(scene, sensor, table, state, day)
    notes = [finer_than_cells(sensor, scene.cell_m)] if sensor.pixel_spacing_m < scene.cell_m else []
    short = [one for one in frame_limits(sensor, frame) if one.margin < 1.0]
    notes += [f"{CANNOT_BE_BUILT} ({one.name}): {one.text} (margin {one.margin:.2g})" for one in short]
    return (*notes, *tops_counted_twice(frame), *blind_channels(sensor, frame, lookups))


def frame_limits(sensor: RadarConfiguration, frame: RadarFrame) -> tuple[Limit, ...]:
    """What hardware allows a radar over the swath of a scene."""
    return limits(sensor, *frame_swath(frame))


def frame_swath(frame: RadarFrame) -> tuple[float, float]:
    """Ground ranges of the swath of a scene [m]."""
    return frame.near_edge_m, frame.near_edge_m + frame.n_rows * frame.cell_m


ENGINES: Mapping[str, Engine] = {
    "psm": Engine(
        configure=radar.from_settings,
        table=partial(loaded, load_sigma0_table),
        simulate=_radar_image,
        examine=_examine_radar,
        # Cultural targets lie in cells of the data base as it is.
        detail_m=lambda sensor: 0.0 if sensor.targets_file else sensor.pixel_spacing_m,
        parameters=SENSORS["psm"],
        threads=True,
        masks=("shadow", "layover"),
    ),
    "prm": Engine(
        configure=radiometer.from_settings,
        table=partial(loaded, load_emissivity_table),
        simulate=simulate_radiometer,
        examine=lambda *of: check_radiometer(*of).notes,
        detail_m=attrgetter("resolution_m"),
        parameters=SENSORS["prm"],
        masks=("blocked",),
    ),
}


_FIELD = "[[application]] utility"


def check_utility(text: str) -> None:
    """Refuse with SpecError a utility of ``campaign.toml`` that images cannot be scored by, or that has no import."""
    if ":" in text:
        find_utility(text)
        return
    if not asked_for(text).row.function:
        known = ", ".join(f'"{name}"' for name, row in UTILITIES.items() if row.function)
        remedy = f'Use {known} or "module:function", or ingest measured scores.'
        raise SpecError("images cannot be scored by this utility, which is measured", remedy, field=_FIELD, value=text)


def score_by(
    text: str, images: Sequence[Image], scene: Scene, *, seed: int, run_id: int, known: KnownMap | None = None
) -> UtilityScore:
    """Score of images by a utility; a function of the user's own is given the image, or all where there are several.

    ``known``: a map that is there already, for utilities that classify.
    """
    if ":" in text:
        shown = [not_writable(image) for image in images]
        return call_utility(text, shown[0] if len(shown) == 1 else shown, _shown(scene), seed=seed, run_id=run_id)
    asked = asked_for(text)
    more = {"known": known} if known is not None and asked.row.classifies else {}
    score: UtilityScore = own_function(asked.row.function)(images, scene, asked, seed=seed, run_id=run_id, **more)
    return score


@lru_cache(maxsize=1)
def _shown(scene: Scene) -> Scene:
    """A scene as functions of the user's own see it: one object for all runs."""
    return not_writable(scene)


def find_utility(name: str) -> Callable[..., Any]:
    """The function called ``name``, "package.module:function" or "path/of/module.py:function".

    SpecError where it cannot be imported, whatever the reason.
    """
    try:
        return own_function(name)
    except (Exception, SystemExit) as error:  # the user's module may do anything
        text = f"the utility cannot be imported: {_words(error)}"
        raise SpecError(text, import_remedy(error), field=_FIELD, value=name) from error


def call_utility(name: str, image: Any, scene: Any, *, seed: int, run_id: int) -> UtilityScore:
    """Score of an image by a utility of the user's own, which returns a `UtilityScore` or a number.

    SpecError where it cannot be imported, raises, or returns no finite score.
    """
    function = find_utility(name)
    short, place = f"{name.rpartition(':')[2]}()", file_of(name) or None  # on a cluster the file has another name
    try:
        with contained():
            found = function(image, scene, seed=seed, run_id=run_id)
    except UserError:
        raise
    except (Exception, SystemExit) as error:  # the user's function may do anything
        _, *places = traceback.extract_tb(error.__traceback__)
        text = f"{short} failed: {_words(error)}"
        remedy = "Let it take (image, scene, *, seed, run_id)."
        if places:
            remedy = f"See line {places[-1].lineno} of {places[-1].filename}."
        raise SpecError(text, remedy, field=_FIELD) from error
    if isinstance(found, int | float | np.number) and not isinstance(found, bool):
        found = UtilityScore(float(found))
    if not isinstance(found, UtilityScore):
        text = f"{short} returned {type(found).__name__}, not a number or a seqrsm.score.classification.UtilityScore"
        raise SpecError(text, "Return one of them.", file=place, field=_FIELD)
    if not math.isfinite(found.value):
        raise SpecError(f"{short} returned {found.value}", "Return a finite number.", file=place, field=_FIELD)
    return found


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
