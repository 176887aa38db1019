"""What a simulated answer rests on: shares of the area by the status of the table rows behind them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.campaign.simulation import NO_RUN, scene_at, task_of
from seqrsm.sensor.radar import RadarConfiguration
from seqrsm.simulate.radar.ground import look_up
from seqrsm.simulate.radar.occasion import nominal_ground_state
from seqrsm.spec.read import CampaignSpec


def rests_on(spec: CampaignSpec, settings: Mapping[str, float | str]) -> dict[str, float]:
    """Shares of the scored area whose mean backscatter or emissivity is measured, published, computed, assumed.

    Parameters
    ----------
    spec : CampaignSpec
        With a simulator.
    settings : Mapping
        Of the sensor; the mean is taken over its channels.

    Returns
    -------
    dict
        Share by status, the best known first; 1 in all, shares of 0 left out.
    """
    found, area, _ = _looked_up(spec, settings)
    shares = dict.fromkeys(("measured", "published", "computed", "assumed"), 0.0)
    for lookup in found:
        for status, share in zip(lookup.status, area.tolist(), strict=True):
            shares["published" if status.startswith("public") else status] += share / len(found)
    return {status: share for status, share in shares.items() if share > 0.0}


def mean_sds(spec: CampaignSpec, settings: Mapping[str, float | str]) -> dict[str, float]:
    """Standard deviation of the mean of each cover of the scored area, [dB] or [1], over the sensor's channels."""
    found, area, names = _looked_up(spec, settings)
    sd = np.mean([one.mean_sd_db if hasattr(one, "mean_sd_db") else one.mean_sd for one in found], axis=0)
    return {name: float(x) for name, x, share in zip(names, sd, area, strict=True) if share > 0.0 and x > 0.0}


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
    cells = np.bincount(scene.cover[scene.scored & scene.valid()], minlength=256)[: len(scene.categories)]
    return found, cells / max(int(cells.sum()), 1), scene.categories
