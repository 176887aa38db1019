"""``seqrsm.Campaign``: the commands as methods, for notebooks and scripts; the commands call it themselves.

The numbers equal those of the commands on the same store, to the bit: like them, methods that compute keep the matrix
libraries to one thread while they run.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, Self, TypeVar

from seqrsm.cli.results import Candidates, Fit, Ingested, Ran, Status
from seqrsm.errors import UserError
from seqrsm.plain import counted, heading
from seqrsm.progress import silent

if TYPE_CHECKING:
    from pandas import DataFrame

    from seqrsm.campaign.campaign import Campaign as Opened
    from seqrsm.score.table import TableSource
    from seqrsm.spec.read import CampaignSpec
    from seqrsm.store.records import RunRecord

_P = ParamSpec("_P")
_T = TypeVar("_T")


def _one_thread(method: Callable[_P, _T]) -> Callable[_P, _T]:
    """Keep matrix libraries to one thread; the commands do so by the environment, which a loaded library ignores."""

    @wraps(method)
    def alone(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(limits=1, user_api="blas"):
            return method(*args, **kwargs)

    return alone


def _see(kind: Any, **given: Any) -> None:
    """UserError where a value is not an instance of ``kind``, a type or a union of types."""
    for name, value in given.items():
        if not isinstance(value, kind):
            raise UserError(f"{name} must be {getattr(kind, '__name__', kind)}", "Correct it.", value=value)


def _see_whole(least: int, **given: Any) -> None:
    """UserError where a value is not a whole number of at least ``least``."""
    for name, value in given.items():
        if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < least:
            raise UserError(f"{name} is a whole number from {least}", "Correct it.", value=value)


class Campaign:
    """An open campaign folder.

    Parameters
    ----------
    folder : str or Path
        The folder that contains ``campaign.toml``.

    Raises
    ------
    UserError
        If the folder or its specification is wrong; methods raise it where a command would end with exit code 2.

    Examples
    --------
    >>> c = seqrsm.Campaign("mine")  # doctest: +SKIP
    >>> plan = c.propose(4)  # what to measure next: a DataFrame
    >>> c.ingest(plan.assign(score=measured))
    >>> c.fit()
    """

    def __init__(self, folder: str | Path) -> None:
        from seqrsm.campaign.campaign import Campaign as Opened  # the numerical libraries: not for `import seqrsm`

        _see(str | Path, folder=folder)
        self._opened = Opened.open(Path(folder))

    @property
    def opened(self) -> Opened:
        """The campaign as ``campaign.toml`` stands now: a notebook stays open while the file is edited."""
        from seqrsm.spec.read import load_spec

        if (spec := load_spec(self._opened.folder)).spec_hash != self._opened.spec.spec_hash:
            self._opened = type(self._opened)(spec, self._opened.store)
        return self._opened

    @classmethod
    def create(
        cls,
        folder: str | Path,
        *,
        factors: Mapping[str, Any] | None = None,
        half_width: float | None = None,
        application: str | Mapping[str, Any] | None = None,
        constraints: str | Sequence[str] = (),
        template: str | None = None,
        **tables: Mapping[str, Any],
    ) -> Self:
        """Create a campaign folder and open it.

        Parameters
        ----------
        folder : str or Path
            A new or empty folder.
        factors : Mapping
            For each name a range ``(low, high)``, a list or array of values or levels, or the keys of a ``[[factor]]``:
            ``{"low": 1.25, "high": 9.6, "unit": "GHz", "scale": "log"}``.
        half_width : float
            Target half-width of the interval at the optimum, in score units.
        application : str or Mapping
            A name, by default that of the folder, for measured scores to be maximized, or the keys of an
            ``[[application]]``.
        constraints : str or sequence of str
            Such as ``"looks <= 4 * resolution"``.
        template : str
            An example to copy, instead of all other arguments; see ``seqrsm init --list``.
        **tables : Mapping
            Further tables of ``campaign.toml``: ``model={"order": 1}``, ``stop={"max_runs": 30}``.
        """
        _see(str | Path, folder=folder)
        _see(str | None, template=template)
        _see(str | Sequence, constraints=constraints)
        place = Path(folder)
        if template is not None:
            from seqrsm.spec.templates import copy_template

            if factors is not None or half_width is not None or application is not None or constraints or tables:
                raise UserError("a template has its own factors and tables", "Edit its campaign.toml.")
            copy_template(template, place)
            return cls(place)
        from seqrsm.spec.write import create_campaign, factor_tables

        if not isinstance(factors, Mapping) or not factors or half_width is None:
            remedy = "Give both, or a template."
            raise UserError("a campaign needs factors, a mapping by name, and half_width", remedy)
        name = place.name if application is None else application
        named = {"name": name, "utility": "measured"} if isinstance(name, str) else name
        content: dict[str, Any] = {
            "factor": factor_tables(factors),
            "constraint": [{"expr": text} for text in ([constraints] if isinstance(constraints, str) else constraints)],
            "application": [named],
            **tables,
        }
        for name, key, value in (("campaign", "name", place.name), ("stop", "half_width", half_width)):
            given = tables.get(name, {})
            content[name] = {key: value, **given} if isinstance(given, Mapping) else given
        create_campaign(place, content)
        return cls(place)

    @property
    def folder(self) -> Path:
        """The campaign's folder."""
        return self.opened.folder

    @property
    def spec(self) -> CampaignSpec:
        """The specification, as read from ``campaign.toml``."""
        return self.opened.spec

    def __repr__(self) -> str:
        return f"seqrsm.Campaign({str(self.folder)!r}): {len(self.opened.store.runs('scored'))} scored runs"

    def __reduce__(self) -> tuple[type[Campaign], tuple[Path]]:
        """Another process opens the folder for itself."""
        return type(self), (self._opened.folder,)

    def close(self) -> None:
        """Close the database, which the next use of the campaign opens again."""
        self.opened.store.close()

    # -- the loop -------------------------------------------------------------------------------------------------

    def void(self, run_ids: int | Iterable[int], why: str) -> None:
        """Exclude a run, or several, from the fit for a reason; nothing is ever deleted."""
        runs = tuple(run_ids) if isinstance(run_ids, Iterable) else (run_ids,)
        for run_id in runs:
            _see_whole(1, run_ids=run_id)
        _see(str, why=why)
        self.opened.store.void([int(run_id) for run_id in runs], why)

    @_one_thread
    def issue(self, n: int | None = None, *, source: str | None = None, csv: Path | None = None) -> list[RunRecord]:
        """Issue the next runs as `propose` does and return records; ``csv``: also write the form to this file."""
        _see_whole(1, n=1 if n is None else n)
        _see(str | None, source=source)
        _see(Path | None, csv=csv)
        if self.spec.simulator is None and source in ("simulation", "best"):
            raise UserError("this campaign has no simulator", "Use flight.", field="source", value=source)
        return list(self.opened.propose(n, source=source, csv=csv))

    def remarks(self, n: int | None, runs: Sequence[RunRecord]) -> list[str]:
        """Why not as many runs were issued as the ``n`` asked for; and that the stop rule asks for none."""
        found = []
        if n is not None and len(runs) != n:
            whole = {"start": "the initial design is issued whole", "confirmation": "confirmation runs come first"}
            why = whole.get(runs[0].purpose, "the budget, [stop] max_runs, leaves no more")
            found.append(f"{counted(len(runs), 'run')} instead of {n}: {why}")
        last = {look.application: look for look in self.opened.store.looks()}
        looked = [last.get(one.name) for one in self.spec.applications]
        begun = all(run.purpose != "start" for run in runs)
        if begun and all(look is not None and look.summary["held"] for look in looked):
            found.append("the stop rule is met: it asks for none of these runs")
        if begun and any(one.utility == "rank" for one in self.spec.applications):
            found.append("have these images ranked along with some earlier ones, or they will have no score")
        return found

    def propose(self, n: int | None = None, *, source: str | None = None) -> DataFrame:
        """Propose and issue the next runs; the first call issues the initial design, which has its own size.

        Parameters
        ----------
        n : int, optional
            Number of runs; by default the campaign's batch.
        source : "simulation", "flight" or "best", optional
            By default simulation if there is a simulator, else flight, which stands for any measurement.

        Returns
        -------
        DataFrame
            The form, a row for each run (and application): ``run_id``, factors in their own units, empty ``score`` and
            ``se``, and the reason in ``note``. Fill in ``score`` and pass it to `ingest`.
        """
        runs = self.issue(n, source=source)
        for told in self.remarks(n, runs):
            warnings.warn(told, stacklevel=2)
        return self.form([run.run_id for run in runs])

    def form(self, run_ids: Iterable[int] | None = None) -> DataFrame:
        """The form for some of the issued runs, by default for all that await a measurement."""
        import pandas as pd

        from seqrsm.campaign.export import form_rows

        _see(Iterable | None, run_ids=run_ids)
        wanted = list(self.opened.store.runs("issued", source="flight")) if run_ids is None else []
        made = {run.run_id: run for run in self.opened.store.runs()}
        for run_id in () if run_ids is None else run_ids:
            _see_whole(1, run_id=run_id)
            state = made[run_id].state if run_id in made else "none of this campaign"
            if state != "issued":
                reason = f"the run awaits no score: it is {state}"
                raise UserError(reason, "Use numbers of issued runs.", field="run", value=run_id)
            wanted.append(made[run_id])
        header, rows = form_rows(self.spec, wanted)
        return pd.DataFrame(rows, columns=pd.Index(header))

    def ingest(self, *tables: TableSource, dry_run: bool = False, accept: bool = False) -> Ingested:
        """Ingest measured scores or interpreters' rankings: all tables, or none.

        Suspect rows, such as a frequency in MHz without unit, -9999 or a duplicate row, raise an error that says what
        is suspected, and nothing is ingested.

        Parameters
        ----------
        *tables : DataFrame, str or Path
            A table in memory or a file (CSV, ``.xlsx``, ``.parquet``) with a column for each factor and ``score``.
        dry_run : bool
            Report what would happen and change nothing.
        accept : bool
            Ingest suspect rows as they are.
        """
        return Ingested(self.opened.ingest(*tables, dry_run=dry_run, accept=accept))

    @_one_thread
    def carry_out(self, **options: Any) -> tuple[RunRecord, ...]:
        """Simulate the issued runs as `simulate` does and return records; ``options``: where, and who is told."""
        _see_whole(1, workers=options.get("workers", 1))
        if self.spec.simulator is None and not self.opened.store.runs(source="simulation"):
            from seqrsm.campaign.simulator_checks import check_simulator

            check_simulator(self.spec)  # which says so
        return self.opened.simulate(**options)

    def simulate(self, workers: int = 1) -> None:
        """Simulate the issued runs."""
        self.carry_out(workers=workers)

    @_one_thread
    def run(self, **options: Any) -> Ran:
        """Run the campaign to its end; see `seqrsm.campaign.loop.run_campaign` for the options."""
        from seqrsm.campaign.loop import run_campaign

        whole = {name: value for name in ("max_runs", "batch", "workers") if (value := options.get(name)) is not None}
        _see_whole(1, **whole)
        return Ran(self.opened, run_campaign(self.opened, **options))

    # -- looking --------------------------------------------------------------------------------------------------

    @_one_thread
    def fit(self, application: str | None = None, *, test: str | Sequence[str] = ()) -> Fit:
        """Model, analysis of variance, optimum, intervals, posterior, decision.

        Parameters
        ----------
        application : str, optional
            Which one, if there are several.
        test : str or sequence of str
            Partial F tests, each of comma-separated factors, terms or groups.
        """
        from seqrsm.analysis.study import term_test

        _see(str | None, application=application)
        _see(str | Sequence, test=test)
        wanted = [test] if isinstance(test, str) else test
        for one in wanted:
            _see(str, test=one)
        opened = self.opened
        analyses = opened.analyse_all(application, sampler="emcee", thorough=True)
        tests = [[term_test(analysis, text) for text in wanted] for analysis in analyses]
        return Fit(opened, analyses, tests, opened.compromise(analyses))

    @_one_thread
    def candidates(
        self, *, worlds: int = 16, workers: int = 1, progress: Callable[[int, int], None] | None = None
    ) -> Candidates:
        """Probability that each sensor of ``[[candidate]]`` suffices, and which properties cost it score.

        Parameters
        ----------
        worlds : int
            Draws of the tables, at least 4, common to all sensors.
        workers : int
            Parallel processes.
        progress : callable
            Called with the numbers of candidates done and in all.
        """
        from seqrsm.campaign.candidates import measure_candidates

        _see_whole(4, worlds=worlds)
        _see_whole(1, workers=workers)
        told = progress or silent
        return Candidates(measure_candidates(self.opened, worlds=worlds, workers=workers, progress=told))

    @_one_thread
    def status(self, *, history: bool = False) -> Status:
        """Runs by state, current optimum and intervals, decision and reasons; ``history``: every event."""
        from seqrsm.campaign.status import campaign_status

        return Status(self.spec, campaign_status(self.folder, history=history))

    def runs(self) -> DataFrame:
        """Every run and score, as ``seqrsm export`` writes them, without units in the names of the columns."""
        import pandas as pd

        from seqrsm.campaign.export import run_rows

        header, rows = run_rows(self.opened.store.runs(), self.spec)
        return pd.DataFrame(rows, columns=pd.Index(header))

    def image(
        self,
        settings: Mapping[str, float | str] | None = None,
        *,
        number: int = 1,
        threads: int = 1,
        **more: float | str,
    ) -> Any:
        """Simulate one image; settings not given default to the current optimum, else to the centre of the region.

        Parameters
        ----------
        settings : Mapping, optional
            By name; also as keyword arguments: ``image(frequency=1.25)``.
        number : int
            Which image of several sensors or dates, from 1.
        threads : int
            Per radar image.

        Returns
        -------
        xarray.Dataset
            If xarray is installed, else a dict of arrays by name. ``image`` is in dB or K, as its ``units`` state;
            settings, scores and a summary are attributes.
        """
        from seqrsm.campaign.images import simulated
        from seqrsm.design.factors import with_units
        from seqrsm.simulate.pictures import labelled_arrays, picture_of

        _see_whole(1, number=number, threads=threads)
        _see(Mapping | None, settings=settings)
        given = {**(settings or {}), **more}
        texts = [f"{name}={value}" for name, value in given.items()]
        made = simulated(self.opened, texts, threads=threads, number=number)
        picture = picture_of(made.image)
        arrays = labelled_arrays(picture)
        told, spec = made.told(picture.values.shape), self.spec
        scores = told["scores"].items()
        attributes = {
            **with_units(spec.factors, told["settings"]),
            **{heading(f"score of {name}", spec.application(name).score_unit): value for name, value in scores},
            "summary": told["summary"],
            "scene": made.scene.name,
        }
        try:
            import xarray
        except ImportError:
            return {**{name: values for name, (_, values, _) in arrays.items()}, **attributes}
        return xarray.Dataset(arrays, coords={"channel": list(picture.channels)}, attrs=attributes)

    @_one_thread
    def report(
        self,
        html: str | Path | None = None,
        pdf: str | Path | None = None,
        figures: str | Path | None = None,
        *,
        step: Callable[[str], None] | None = None,
    ) -> tuple[Path, ...]:
        """Write the report, by default HTML and PDF into the campaign's ``reports``; return the files written."""
        from seqrsm.campaign.dossier import assemble
        from seqrsm.files import see_writable
        from seqrsm.report import write_report

        _see(str | Path | None, html=html, pdf=pdf, figures=figures)
        if html is None and pdf is None and figures is None:
            html, pdf = self.folder / "reports" / "report.html", self.folder / "reports" / "report.pdf"
        given = {"html": html, "pdf": pdf, "figures": figures}
        files = {name: Path(file) for name, file in given.items() if file is not None}
        places = [file / "captions.csv" if name == "figures" else file for name, file in files.items()]
        see_writable(*places, make_folder=True)
        for name, file in files.items():
            if name != "figures" and file.suffix.lower() != f".{name}":
                raise UserError("unknown kind of report", f"Name a .{name} file.", file=str(file))
        told = step or silent
        return write_report(assemble(self.opened, told), **files, step=told)
