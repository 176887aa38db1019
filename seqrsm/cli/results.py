"""What methods of ``seqrsm.Campaign`` return: results that display themselves in a terminal and in a notebook."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from seqrsm.plain import plain

if TYPE_CHECKING:
    from pandas import DataFrame

    from seqrsm.analysis.compromise import CompromiseEstimate
    from seqrsm.analysis.results import Analysis
    from seqrsm.analysis.study import TermTest
    from seqrsm.campaign.campaign import Campaign
    from seqrsm.campaign.ingest import IngestReport
    from seqrsm.campaign.loop import Outcome
    from seqrsm.report.blocks import Section
    from seqrsm.spec.read import CampaignSpec


class Shown:
    """A result that displays itself in a terminal and in a notebook."""

    def show(self) -> None:
        """Print it as the command does."""
        raise NotImplementedError

    def __repr__(self) -> str:
        from seqrsm.cli.console import on_page

        return on_page(self.show)


class Sections(Shown):
    """A result displayed as sections of the report: ``sections``."""

    sections: tuple[Section, ...]

    def show(self) -> None:
        """Print them as the command does."""
        from seqrsm.cli.blocks import show_sections

        show_sections(self.sections)

    def _repr_html_(self) -> str:
        from seqrsm.report.html import render_sections

        return render_sections(self.sections)


@dataclass(repr=False, eq=False)
class Ingested(Shown):
    """The outcome for each table of scores: ``reports``."""

    reports: tuple[IngestReport, ...]

    def show(self) -> None:
        """Print it as ``seqrsm ingest`` does."""
        from seqrsm.cli.show import show_ingest

        for report in self.reports:
            show_ingest(report)

    def to_json(self) -> list[dict[str, Any]]:
        """As ``seqrsm ingest --json``."""
        found: list[dict[str, Any]] = plain(self.reports)
        return found


@dataclass(repr=False, eq=False)
class Status(Shown):
    """Where a campaign stands."""

    spec: CampaignSpec
    _result: Mapping[str, Any]

    def show(self) -> None:
        """Print it as ``seqrsm status`` does."""
        from seqrsm.cli.show_fit import show_status

        show_status(self.spec, self._result)

    def to_json(self) -> dict[str, Any]:
        """As ``seqrsm status --json``."""
        found: dict[str, Any] = plain(self._result)
        return found


@dataclass(repr=False, eq=False)
class Ran(Shown):
    """How a call of `seqrsm.Campaign.run` ended: ``outcome``."""

    campaign: Campaign
    outcome: Outcome

    @property
    def held(self) -> bool:
        """The stop rule holds; otherwise the budget is spent."""
        return self.outcome.held

    def show(self) -> None:
        """Print it as ``seqrsm run`` does."""
        from seqrsm.cli.show_fit import show_outcome

        show_outcome(self.campaign, self.outcome)

    def to_json(self) -> dict[str, Any]:
        """As ``seqrsm run --json``."""
        return self.outcome.to_json()


class Candidates(Sections):
    """Candidate sensors compared with the optimum."""

    def __init__(self, result: Mapping[str, Any]) -> None:
        from seqrsm.report.sections.candidates import candidate_section

        section = candidate_section(result, every=True)
        self._result = result
        self.sections = () if section is None else (section,)

    def to_json(self) -> Mapping[str, Any]:
        """As ``seqrsm candidates --json``."""
        return self._result

    def to_frame(self) -> DataFrame:
        """A row for each application and candidate, in order of the probability of sufficing.

        Probability of sufficing, score, difference from the optimum and interval ends, in score units; missing where a
        candidate could not be evaluated, for the reason in ``why``.
        """
        import pandas as pd

        rows = []
        for application, found in self._result["applications"].items():
            for one in found["candidates"]:
                row = {"application": application, "candidate": one["name"], "how": one["how"]}
                row["score_unit"] = found["unit"]
                row |= {name: one.get(name) for name in ("probability", "score", "difference")}
                for kind in ("confidence", "one_ground"):
                    row |= {f"{kind}_{end}": one.get(kind, {}).get(end) for end in ("low", "high")}
                rows.append({**row, "recalled": ", ".join(one.get("recalled", ())), "why": one.get("why", "")})
        return pd.DataFrame(rows)


@dataclass(repr=False, eq=False)
class Fit(Sections):
    """The fitted model and what follows from it."""

    campaign: Campaign
    """As opened."""
    analyses: tuple[Analysis, ...]
    """One for each application, with every number."""
    tests: Sequence[Sequence[TermTest]]
    """The tests requested, for each."""
    compromise: CompromiseEstimate | None
    """Over several applications and considerations."""

    @cached_property
    def sections(self) -> tuple[Section, ...]:  # type: ignore[override]
        """The summary: recommendation, intervals and decision."""
        from seqrsm.report.sections.summary import summary_section

        spec, store = self.campaign.spec, self.campaign.store
        found = summary_section(spec, self.analyses, self.compromise, store.runs(), rankings=store.ranking_summaries())
        return (found,)

    def show_all(self) -> None:
        """Print everything that ``seqrsm fit`` prints, the summary last."""
        from seqrsm.cli.show_fit import show_fit

        show_fit(self.campaign, self.analyses, self.tests, self.compromise)
        self.show()

    def to_json(self) -> dict[str, Any]:
        """As ``seqrsm fit --json``."""
        from seqrsm.analysis.to_json import analysis_to_json, tests_to_json

        documents: list[dict[str, Any]] = [
            analysis_to_json(analysis) | ({"tests": tests_to_json(found)} if found else {})
            for analysis, found in zip(self.analyses, self.tests, strict=True)
        ]
        document = documents[0] if len(documents) == 1 else {"applications": documents}
        if self.compromise is not None:
            document = {**document, "compromise": self.compromise.to_json()}
        found: dict[str, Any] = plain(document)
        return found

    def to_frame(self) -> DataFrame:
        """A row for each application: recommended settings, mean, the ends of each interval, and the decision."""
        import pandas as pd

        rows = []
        for analysis in self.analyses:
            best, row = analysis.optimum, {"application": analysis.application, **analysis.optimum.settings}
            row |= {"score_unit": analysis.score_unit, "mean": best.mean}
            for kind in ("confidence", "prediction", "prediction_mean"):
                interval = getattr(best, kind)
                row |= {f"{kind}_low": interval.low, f"{kind}_high": interval.high}
            row |= {"half_width": analysis.decision.half_width, "expected_loss": analysis.posterior.expected_regret}
            row["n_runs"] = analysis.fit.n_runs
            rows.append({**row, "stop": analysis.decision.held})
        return pd.DataFrame(rows)

    def plot(self) -> Plot:
        """The fitted surface: contours over the most important factors, and slices through the optimum."""
        from seqrsm.report.sections.optimum import surface_section

        return Plot(tuple(surface_section(analysis, f"plot-{i}") for i, analysis in enumerate(self.analyses)))


@dataclass(repr=False, eq=False)
class Plot(Sections):
    """Figures for a notebook; `seqrsm.Campaign.report` writes all of a campaign's figures to files."""

    sections: tuple[Section, ...]

    def show(self) -> None:
        """Print the caption of each figure, since a terminal shows no pictures."""
        from seqrsm.cli.console import line
        from seqrsm.report.blocks import FigureBlock, unfolded

        for section in self.sections:
            for block in unfolded(section.blocks):
                if isinstance(block, FigureBlock):
                    line(block.caption)
