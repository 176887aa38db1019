"""What a simulated answer rests on: shares of the area by the status of the table rows behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from seqrsm.arrays import FloatArray, IntArray
from seqrsm.campaign.simulation import NO_RUN, scene_at, task_of
from seqrsm.scattering.calendar import has_course, on_day
from seqrsm.scene.scene import NO_COVER, Scene
from seqrsm.sensor.radar import GROUND_OF, RadarConfiguration
from seqrsm.sensor.sets import day_of_year
from seqrsm.simulate.radar.occasion import look_up, nominal_ground_state
from seqrsm.spec.read import CampaignSpec
from seqrsm.units import linear_to_db

_CROPS: Final = 6


def rests_on(spec: CampaignSpec, settings: Mapping[str, float | str]) -> dict[str, float]:
    """Shares of the scored area whose mean backscatter or emissivity is measured, published, computed, assumed.

    By status, the best known first; 1 in all, shares of 0 left out. The mean is taken over the sensor's channels.
    """
    found, area, _ = _looked_up(spec, settings)
    shares = dict.fromkeys(("measured", "published", "computed", "assumed"), 0.0)
    for lookup in found:
        for status, share in zip(lookup.status, area.tolist(), strict=True):
            shares["published" if status.startswith("public") else status] += share / len(found)
    return {status: share for status, share in shares.items() if share > 0.0}


def mean_sds(spec: CampaignSpec, settings: Mapping[str, float | str]) -> tuple[dict[str, float], str]:
    """Standard deviation of the mean of each cover of the scored area, over the channels of the images, and its unit.

    Of backscatter [dB]; of emissivity [1] where there are radiometers alone.
    """
    found, area, names = _looked_up(spec, settings)
    of_radars = [one.mean_sd_db for one in found if hasattr(one, "mean_sd_db")]
    sd = np.mean(of_radars or [one.mean_sd for one in found], axis=0)
    covers = {name: float(x) for name, x, share in zip(names, sd, area, strict=True) if share > 0.0 and x > 0.0}
    return covers, "dB" if of_radars else ""


@dataclass(frozen=True, slots=True, eq=False)
class CropCalendar:
    """Backscatter of the crops of a scene over the year in the channels of a campaign's radars."""

    crops: tuple[str, ...]
    """Covers of the scored area that change over the year, the largest first, six at most."""
    channels: tuple[str, ...]
    """Such as "C VV"."""
    sigma0_db: FloatArray
    """(n_channels, n_crops, 365): at 40 degrees [dB]."""
    days: tuple[float, ...]
    """Days of the year of the images at the recommended settings, in their order."""


def crop_calendar(spec: CampaignSpec, settings: Mapping[str, float | str]) -> CropCalendar | None:
    """Calendar of the crops that a campaign with dates looks at, one panel a channel; None without dates, or radars."""
    task = task_of(spec, NO_RUN, settings)
    scene, made = scene_at(task.scene), task.acquisitions
    radars = {one.member: one for one in made if isinstance(one.sensor, RadarConfiguration) and one.visit.days}
    cells = _scored_cells(scene)
    own = task.scattering(task.engine).calendar.own
    covers = [scene.categories[k] for k in np.argsort(-cells) if cells[k]]
    crops = tuple(name for name in covers if name in own or has_course(name))[:_CROPS]
    if not radars or not crops:
        return None
    channels, levels = [], []
    for one in radars.values():
        day = one.visit.days[one.visit.number]
        for channel in filter(GROUND_OF.get, one.sensor.channels):
            find = task.scattering(one.engine).lookup
            found = find(crops, one.sensor.frequency_ghz, GROUND_OF[channel], day=day)
            at_day = linear_to_db(found.sigma0[:, 40])
            channels.append(f"{one.member or f'{one.sensor.frequency_ghz:.3g} GHz'} {channel}")
            levels.append((at_day - on_day(found.course.change_db, day))[:, None] + found.course.change_db)
    return CropCalendar(crops, tuple(channels), np.array(levels), tuple(map(day_of_year, made[0].visit.days)))


def _scored_cells(scene: Scene) -> IntArray:
    """Scored cells of each category (n_categories,)."""
    cover = scene.cover[scene.scored & scene.valid()]
    return np.bincount(cover, minlength=NO_COVER + 1)[: len(scene.categories)]


def _looked_up(
    spec: CampaignSpec, settings: Mapping[str, float | str]
) -> tuple[list[Any], FloatArray, tuple[str, ...]]:
    """Look-ups of all channels, share of each category in the scored area, and the categories' names."""
    task = task_of(spec, NO_RUN, settings)
    scene = scene_at(task.scene)
    found: list[Any] = []
    for one in task.acquisitions:
        sensor, table, day = one.sensor, task.scattering(one.engine), one.visit.day
        if isinstance(sensor, RadarConfiguration):
            found += look_up(scene, sensor, table, nominal_ground_state(sensor), day)
        else:
            found += [table.lookup(scene.categories, sensor.frequency_ghz, c, day=day) for c in sensor.channels]
    cells = _scored_cells(scene)
    return found, cells / max(int(cells.sum()), 1), scene.categories
