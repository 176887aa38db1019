"""The two engines behind one face: how settings become a sensor, an image, and what is kept with a score."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from seqrsm.campaign.own_utility import call_utility, find_utility
from seqrsm.errors import Problem, SpecError
from seqrsm.scattering.emissivity import EmissivityTable, load_emissivity_table
from seqrsm.scattering.sigma0 import Sigma0Table, load_sigma0_table
from seqrsm.scene.scene import Scene
from seqrsm.score.classification import UtilityScore, percent_correct
from seqrsm.score.retrieval import percent_correct_radiometer, soil_moisture_error
from seqrsm.sensor import radar, radiometer
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.sensor.radiometer import RadiometerConfiguration
from seqrsm.simulate.frame import make_frame
from seqrsm.simulate.prm import check_radiometer, simulate_radiometer
from seqrsm.simulate.prm_image import RadiometerImage
from seqrsm.simulate.psm import Precision, RadarImage, simulate_radar
from seqrsm.simulate.receiver import transfer_function
from seqrsm.simulate.targets import CulturalTarget, check_targets, load_targets
from seqrsm.units import linear_to_db

Image = RadarImage | RadiometerImage
Sensor = RadarConfiguration | RadiometerConfiguration
Settings = Mapping[str, float | str]


class Utility(Protocol):
    """A utility measure of a simulated image, keyed by campaign seed and run."""

    def __call__(self, image: Any, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
        """Score the image."""


@dataclass(frozen=True, slots=True)
class Engine:
    """One of the report's two models.

    Attributes
    ----------
    configure : callable
        Settings and fixed parameters -> sensor; raises ConfigurationError.
    table : callable
        Path, or "" for the shipped one -> table of sigma0 or emissivity, read once per process.
    simulate : callable
        Scene, sensor, table, seed, run id and, where it is not to be single, precision -> image.
    examine : callable
        Scene, sensor and table -> what the combination of parameters does, each note as "kind: what"; raises UserError
        where the sensor cannot image the scene, without imaging it.
    record : callable
        What is kept with a score.
    utilities : Mapping
        Utility measures by the names of ``campaign.toml``.
    files : tuple of str
        Sensor parameters that name a file; in ``campaign.toml`` its path is from the campaign's folder.
    threads : bool
        Whether `simulate` takes a number of threads.
    masks : tuple of str
        Masks of the scene's grid that its images have.
    """

    configure: Callable[[Settings, Settings], Any]
    table: Callable[[str], Any]
    simulate: Callable[..., Any]
    examine: Callable[[Scene, Any, Any], tuple[str, ...]]
    record: Callable[[Any, Scene], dict[str, Any]]
    utilities: Mapping[str, Utility]
    files: tuple[str, ...] = ()
    threads: bool = False
    masks: tuple[str, ...] = ()

    def check_utility(self, name: str) -> None:
        """Refuse a utility measure that the engine does not have and that cannot be imported.

        Raises
        ------
        SpecError
            What is wrong with it.
        """
        if name in self.utilities:
            return
        if ":" in name:
            find_utility(name)
            return
        known = ", ".join(f'"{own}"' for own in self.utilities)
        raise SpecError(
            Problem(
                "this engine cannot score the utility",
                f'Use {known} or "module:function", or ingest measured scores.',
                field="[[application]] utility",
                value=name,
            )
        )

    def score(self, name: str, image: Any, scene: Scene, *, seed: int, run_id: int) -> UtilityScore:
        """Score of an image by the utility measure called ``name``: the engine's own, or "module:function"."""
        if name in self.utilities:
            return self.utilities[name](image, scene, seed=seed, run_id=run_id)
        return call_utility(name, image, scene, seed=seed, run_id=run_id)


@lru_cache(maxsize=4)
def _loaded(load: Callable[[str | None], Any], path: str, modified_ns: int) -> Any:
    del modified_ns  # part of the key: an edited table is read again
    return load(path or None)


def _sigma0(path: str) -> Sigma0Table:
    table: Sigma0Table = _loaded(load_sigma0_table, path, modified_ns(path))
    return table


def _emissivity(path: str) -> EmissivityTable:
    table: EmissivityTable = _loaded(load_emissivity_table, path, modified_ns(path))
    return table


def modified_ns(path: str) -> int:
    """When a file was last changed [ns]; 0 where there is none."""
    return Path(path).stat().st_mtime_ns if path and Path(path).exists() else 0


def _radar_image(
    scene: Scene,
    sensor: RadarConfiguration,
    table: Sigma0Table,
    seed: int,
    run_id: int,
    precision: Precision = "float32",
    threads: int = 1,
) -> RadarImage:
    targets = _targets(sensor.targets_file)
    return simulate_radar(
        scene, sensor, table, seed=seed, run_id=run_id, precision=precision, threads=threads, targets=targets
    )


def _targets(path: str) -> tuple[CulturalTarget, ...]:
    found: tuple[CulturalTarget, ...] = _loaded(load_targets, path, modified_ns(path)) if path else ()
    return found


def _radiometer_image(
    scene: Scene,
    sensor: RadiometerConfiguration,
    table: EmissivityTable,
    seed: int,
    run_id: int,
    precision: Precision = "float32",
) -> RadiometerImage:
    return simulate_radiometer(scene, sensor, table, seed=seed, run_id=run_id, precision=precision)


def _examine_radar(scene: Scene, sensor: RadarConfiguration, table: Sigma0Table) -> tuple[str, ...]:
    make_frame(scene, sensor, "float32")
    transfer_function(sensor, 1.0)
    check_targets(_targets(sensor.targets_file), scene.shape)
    for channel in sensor.channels:
        table.lookup(scene.categories, sensor.frequency_ghz, channel, season=sensor.season)
    return ()


def _examine_radiometer(scene: Scene, sensor: RadiometerConfiguration, table: EmissivityTable) -> tuple[str, ...]:
    return check_radiometer(scene, sensor, table).notes


def _radar_record(image: RadarImage, scene: Scene) -> dict[str, Any]:
    noise_db = linear_to_db(image.noise_equivalent_sigma0)
    return {
        "engine": "psm",
        "looks": [float(image.looks.min()), float(image.looks.max())],
        "noise_equivalent_sigma0_db": [round(float(np.min(noise_db)), 2), round(float(np.max(noise_db)), 2)],
        "occasion": dict(image.occasion.record(image.radar.channels, scene.categories)),
    }


def _radiometer_record(image: RadiometerImage, scene: Scene) -> dict[str, Any]:
    return dict(image.record(scene.categories))


ENGINES: Mapping[str, Engine] = {
    "psm": Engine(
        configure=radar.from_settings,
        table=_sigma0,
        simulate=_radar_image,
        examine=_examine_radar,
        record=_radar_record,
        utilities={"percent_correct": percent_correct},
        files=("targets_file", "pattern_file"),
        threads=True,
        masks=("shadow", "layover"),
    ),
    "prm": Engine(
        configure=radiometer.from_settings,
        table=_emissivity,
        simulate=_radiometer_image,
        examine=_examine_radiometer,
        record=_radiometer_record,
        utilities={"percent_correct": percent_correct_radiometer, "retrieval_error": soil_moisture_error},
        files=("beam_file",),
        masks=("blocked",),
    ),
}
