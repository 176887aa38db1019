"""Pictures of a radiometer for the report: on the cells of the ground truth, in its frame."""

from __future__ import annotations

import numpy as np
import prm_cases

from seqrsm.campaign.images import _on_ground
from seqrsm.simulate.pictures import grey_scales, greytones, picture_of


def test_radiometer_pictures_lie_on_the_ground_truth():
    """Half the ground is cold: every cell shows the tone of its own footprint, in the frame of the truth."""
    cover = np.zeros((60, 80), dtype=np.uint8)
    cover[:, 40:] = 1
    site = prm_cases.scene(np.zeros(cover.shape), 10.0, cover)
    for heading in (0.0, 90.0):
        given = prm_cases.radiometer(resolution_m=40.0, altitude_m=2000.0, speed_m_s=60.0, heading_deg=heading)
        picture = picture_of(prm_cases.image(site, given, prm_cases.Table((0.95, 0.5))))
        grey = _on_ground(greytones(picture, grey_scales([picture])), picture)[0]
        truth = np.rot90(cover, picture.quarter_turns)
        assert grey.shape == truth.shape
        away = np.broadcast_to(np.abs(np.arange(80) - 39.5) > 4.0, cover.shape)
        inner = np.rot90(away, picture.quarter_turns)
        assert grey[(truth == 0) & inner].min() > 200
        assert grey[(truth == 1) & inner].max() < 50
