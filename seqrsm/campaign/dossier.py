"""Everything a report shows, as data: the one object that passes from the campaign to ``seqrsm.report``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from seqrsm.analysis.compromise import CompromiseEstimate
from seqrsm.analysis.results import Analysis
from seqrsm.arrays import AnyArray
from seqrsm.spec.read import CampaignSpec
from seqrsm.store.records import EventRecord, LookRecord, RunRecord


@dataclass(frozen=True, slots=True)
class ImagePanel:
    """One simulated image with what is needed to read it.

    Attributes
    ----------
    title : str
        For example "At the optimum".
    settings : Mapping[str, float | str]
        Sensor settings in natural units, by factor name.
    channels : tuple of str
        Polarization of each plane of ``greytone``.
    greytone : ndarray (channels, across, along) of uint8
        RSL TR 380-1 eq. (3-18); across the track from near to far range, or in the direction of the sweep.
    pixel_m : float
        Ground size of a pixel [m].
    score, score_se : float
        Utility of this image and its standard error, in score units.
    caption : str
        What the image shows and what was drawn at random.
    """

    title: str
    settings: Mapping[str, float | str]
    channels: tuple[str, ...]
    greytone: AnyArray
    pixel_m: float
    score: float
    score_se: float
    caption: str


@dataclass(frozen=True, slots=True)
class TruthPanel:
    """The ground truth in the frame of the images.

    Attributes
    ----------
    cover : ndarray (range, azimuth) of uint8
        Index into ``categories``; 255 is no data.
    categories : tuple of str
        Names of the cover categories.
    cell_m : float
        Size of a data-base cell [m].
    name, licence, provenance : str
        What the site is, and its terms of use.
    """

    cover: AnyArray
    categories: tuple[str, ...]
    cell_m: float
    name: str
    licence: str
    provenance: str


@dataclass(frozen=True, slots=True)
class Dossier:
    """A campaign as it stands, ready to be shown.

    Attributes
    ----------
    spec : CampaignSpec
        What was asked.
    analyses : tuple of Analysis
        One for each application, in the order of ``campaign.toml``.
    runs : tuple of RunRecord
        Every run, void and failed ones included.
    looks : tuple of LookRecord
        The interval at the optimum after each batch.
    events : tuple of EventRecord
        The history.
    images : tuple of ImagePanel
        Simulated images; empty for a campaign without a simulator.
    truth : TruthPanel or None
        Ground truth of the simulated site.
    assumptions : tuple of str
        Every assumption of the simulation, one sentence each.
    provenance : Mapping[str, str]
        Versions, seed, hashes, data sources: label to value, in the order to be shown. No times of day: equal campaigns
        have equal reports.
    reproduce : tuple of str
        Commands that reproduce this campaign.
    compromise : CompromiseEstimate or None
        Of several applications, or of one with other considerations.
    tradeoff : Mapping or None
        What ``seqrsm tradeoff`` measured last, see `seqrsm.campaign.tradeoff`.
    plan : Mapping or None
        What the fidelity planner says of the recommended settings, see `seqrsm.campaign.images.explain_image`.
    """

    spec: CampaignSpec
    analyses: tuple[Analysis, ...]
    runs: tuple[RunRecord, ...]
    looks: tuple[LookRecord, ...]
    events: tuple[EventRecord, ...]
    images: tuple[ImagePanel, ...]
    truth: TruthPanel | None
    assumptions: tuple[str, ...]
    provenance: Mapping[str, str]
    reproduce: tuple[str, ...]
    compromise: CompromiseEstimate | None = None
    tradeoff: Mapping[str, Any] | None = None
    plan: Mapping[str, Any] | None = None
