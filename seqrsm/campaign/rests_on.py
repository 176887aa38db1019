"""What a simulated answer rests on: shares of the area by the status of the table rows behind them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from seqrsm.campaign.simulation import NO_RUN, configuration, scene_at, task_of
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
    task = task_of(spec, NO_RUN, settings)
    scene, sensor, table = scene_at(task.scene), configuration(task), task.scattering
    if isinstance(sensor, RadarConfiguration):
        found = [lookup.status for lookup in look_up(scene, sensor, table, nominal_ground_state(sensor))]
    else:
        found = [table.lookup(scene.categories, sensor.frequency_ghz, channel).status for channel in sensor.channels]
    cells = np.bincount(scene.cover[scene.scored & scene.valid()], minlength=len(scene.categories))
    area = cells[: len(scene.categories)] / max(int(cells[: len(scene.categories)].sum()), 1)
    shares = dict.fromkeys(("measured", "published", "computed", "assumed"), 0.0)
    for statuses in found:
        for status, share in zip(statuses, area.tolist(), strict=True):
            shares["published" if status.startswith("public") else status] += share / len(found)
    return {status: share for status, share in shares.items() if share > 0.0}
