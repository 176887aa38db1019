"""What a number of runs can give: half-width and loss expected, for the model as it is and for smaller ones.

Campaigns are simulated on surfaces drawn from what is known: half of the runs behind the start design spread, half at
the best settings that the others show, a polynomial fitted. Where scores favour another surface than a quadratic, they
go on from these scores instead, see `plans_by_process`. It is quick and rough; `seqrsm.campaign.rehearsal` makes every
step as `run` does, once there are scores.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from seqrsm.analysis.results import Analysis
from seqrsm.arrays import FloatArray
from seqrsm.decide.stopping import StopRule, amount, forecast
from seqrsm.design.factors import setting_with_unit
from seqrsm.design.quadratic import QuadraticModel
from seqrsm.design.region import Region
from seqrsm.fit.optimum import Goal, sign_of
from seqrsm.fit.process import FEW, MOST_SETTINGS, prior_covariances
from seqrsm.fit.transforms import logit_scores, logit_to_percent, logit_variance
from seqrsm.propose.cloud import Runs, cloud_of, propose_from_process
from seqrsm.rng import batch_seed, generator

N_CAMPAIGNS = 200
_LEAST_CLOUD = 400
_PLACES, _TOGETHER, _BATCHES = 600, 4, 10  # of campaigns on surfaces that are no quadratics: at most, at least, at most
_NUGGET = 1e-8
_ROUNDS = 12  # until surfaces of logits vary as they should
_EXTRA = 6
"""Runs of a start design beyond the terms."""

_AS_NARROW = 1.1  # as the narrowest half-width listed: below that the loss decides


@dataclass(frozen=True, slots=True)
class Surfaces:
    """What is known of the surface: coefficients drawn, the scatter of a run, and where both come from."""

    model: QuadraticModel
    """Of the truths."""
    coefficients: FloatArray
    """(m, p): a truth in each row, on the scale of the fit."""
    noise: float
    """Standard deviation of a run, score units."""
    source: str
    """In words."""
    logit: bool = False
    """That scale is the logit of percent scores; else that of the scores."""
    at_best: float = 1.0
    """Standard deviation of a future run at the optimum, where the ground was simulated, over ``noise``."""
    level: float = float("nan")
    """Score at which runs scatter by ``noise``, where they scatter as shares do [%]; nan: where they scatter alike."""

    def scores(self, values: FloatArray) -> FloatArray:
        """Scores (score units) of values on the scale of the fit."""
        return logit_to_percent(values) if self.logit else values

    def slope(self, values: FloatArray) -> FloatArray:
        """Change (n, m) of the score with values (n, m) on the scale of the fit; (n, 1) where it is one for all m."""
        if not self.logit:
            return np.ones((len(values), 1))
        return 1.0 / np.sqrt(logit_variance(logit_to_percent(values), equal=True))

    def scatter(self, values: FloatArray) -> FloatArray:
        """Standard deviation (n, m) of runs in score units over ``noise``; (n, 1) where they scatter alike."""
        if np.isnan(self.level):
            return np.ones((len(values), 1))
        here, there = (
            np.sqrt(logit_variance(percent) / logit_variance(percent, equal=True))
            for percent in (logit_to_percent(values), np.array(self.level))
        )
        return np.asarray(here / there)


@dataclass(frozen=True, slots=True)
class Plan:
    """What one way to spend runs is expected to give."""

    change: str
    """What would differ in ``campaign.toml``; "" for the campaign as it is."""
    runs: int
    n_terms: int
    asked: int
    """Runs, terms of the model, and the fewest runs that the stop rule asks for."""
    half_width: float
    loss: float
    """Half-width of the interval that decides, the median of campaigns or by `forecast`, and mean loss against the best
    settings of the whole region, score units; nan where the runs leave no degree of freedom."""

    def reaches(self, target: float, target_loss: float) -> bool:
        """Whether the stop rule can be expected to hold; a target that is nan is not asked about."""
        narrow = bool(np.isfinite(self.half_width)) and not self.half_width > target
        return self.runs >= self.asked and narrow and not self.loss > target_loss


def way_out(
    plans: Sequence[Plan], over: Sequence[Plan], target: float, target_loss: float, unit: str, own: Collection[str] = ()
) -> str:
    """What would reach targets that the campaign as it is does not, the least loss first; in sentences.

    ``own``: keys of the targets that stand in the application's table and not in [stop].
    """

    def told(plan: Plan) -> str:
        return f"half-width {amount(plan.half_width, unit, target)}, loss {amount(plan.loss, unit, target_loss)}"

    budget = plans[0].runs
    good = sorted((p for p in plans if p.change and p.reaches(target, target_loss)), key=lambda plan: plan.loss)
    ways = "; or ".join(f"{plan.change} ({told(plan)})" for plan in good[:3])
    found = [f"With {budget} runs: {ways}."] if good else []
    more = (p for p in over if not p.change and p.runs > budget and p.reaches(target, target_loss))
    if (enough := next(more, None)) is not None:
        found.append(f"{'Or' if found else 'Set'} max_runs = {enough.runs} ({told(enough)}).")
    if found:
        return " ".join(found)
    widths = [plan for plan in (*plans, *over) if np.isfinite(plan.half_width) and plan.runs >= max(plan.asked, budget)]
    if not widths:
        return "Raise max_runs, or use fewer factors or levels."
    narrow = max(_AS_NARROW * min(plan.half_width for plan in widths), target)
    near = min((plan for plan in widths if plan.half_width <= narrow), key=lambda plan: plan.loss)
    how = f"{near.runs} runs" + (f" and {near.change}" if near.change else "")
    missed = {"half_width": near.half_width > target, "loss": near.loss > target_loss}
    in_stop, in_own = ([key for key in missed if missed[key] and (key in own) == mine] for mine in (False, True))
    tables = (("[stop]", in_stop), ("[[application]]", in_own))
    keys = " and ".join(f"{table} {' and '.join(of_table)}" for table, of_table in tables if of_table)
    return f"Nearest: {how} ({told(near)})." + f" Widen {keys} to that, or more." * bool(keys)


def random_surfaces(
    region: Region, noise: float, spread: float, source: str, seed: int, level: float | None = None
) -> Surfaces:
    """Quadratics drawn at random, whose scores have the standard deviation ``spread`` over the region.

    Slopes and differences of levels have twice the standard deviation of squares and products. With a ``level`` [%]
    they are quadratics of logits about that of this score.
    """
    rng = generator(seed, 0, "budget: surfaces")
    model, first = QuadraticModel(region.factors, 2), QuadraticModel(region.factors, 1).p
    beta = rng.standard_normal((N_CAMPAIGNS, model.p))
    beta[:, first:] *= 0.5
    values = model.matrix(region.sample(500, rng)) @ beta.T
    if level is None:
        return Surfaces(model, beta * (spread / np.std(values, axis=0))[:, None], noise, source)
    beta[:, 0] -= values.mean(axis=0)
    values, middle = values - values.mean(axis=0), logit_scores(np.array(level))
    size = np.full(N_CAMPAIGNS, 1.0)
    for _ in range(_ROUNDS):
        size *= spread / np.std(logit_to_percent(middle + size * values), axis=0)
    return Surfaces(model, beta * size[:, None] + middle * np.eye(model.p)[0], noise, source, logit=True)


@dataclass(frozen=True)
class Budget:
    """The question."""

    region: Region
    order: int
    goal: Goal
    rule: StopRule
    """Of the campaign."""
    known: Surfaces
    """What is known of its surface."""
    at: FloatArray
    """(k,): where a factor would be fixed."""
    seed: int

    constants: int = 0
    """Of the blocks so far, which are terms beside those of the model."""

    def plans(self, confirmation: int) -> tuple[tuple[Plan, ...], tuple[Plan, ...]]:
        """What the budget gives in different ways, and what other numbers of runs give.

        The budget: as it is, with the guard "confirmation", which takes so many runs of it, with first order, with each
        factor fixed. Numbers of runs: about the budget and what the models ask for, with the campaign's order and with
        1.
        """
        region, budget, order = self.region, self.rule.max_runs, self.order
        whole = tuple(range(region.k))
        ways = [("", order), ("[model] order = 1", 1)][:order]
        at_budget = [plan for change, one in ways for plan in self.by_runs([budget], one, whole, change)]
        asked = [plan.asked for plan in at_budget]
        if self.rule.guard == "runs" and asked[0] > budget:
            (fewer,) = self.by_runs([budget - confirmation], order, whole)
            least = fewer.n_terms + self.constants + 1 + confirmation
            at_budget.insert(1, replace(fewer, change='[stop] guard = "confirmation"', runs=budget, asked=least))
        shown = region.decode(self.at[None, :])[0]
        for factor in region.factors if region.k > 1 else ():
            change = f"{factor.name} fixed at {setting_with_unit(factor, shown[factor.name])}"
            kept = tuple(i for i in whole if region.factors[i] is not factor)
            at_budget += self.by_runs([budget], order, kept, change)
        counts = _counts(budget, asked)
        by_order = [self.by_runs(counts, one, whole, change) for change, one in ways]
        return tuple(at_budget), tuple(plan for plans in zip(*by_order, strict=True) for plan in plans)

    def by_runs(self, counts: Sequence[int], order: int, kept: Sequence[int], change: str = "") -> list[Plan]:
        """What numbers of runs give: a plan for each, none where no two settings are left.

        The model is of this ``order``, factors that are not ``kept`` are fixed; ``change`` is that of `Plan`.
        """
        model = QuadraticModel(tuple(self.region.factors[j] for j in kept), order)
        points = self._cloud.copy()
        fixed = [j for j in range(self.region.k) if j not in kept]
        points[:, fixed] = self.at[fixed]
        points = points[self.region.feasible(points)] if fixed else points
        if len(points) < 2:
            return []
        Z = model.matrix(points[:, list(kept)])
        truth = self.known.model.matrix(points) @ self.known.coefficients.T  # (points, campaigns)
        rows = _greedy(Z, max(_n_spread(n, model.p) for n in counts))
        return [self._plan(change, n, model.p, Z, truth, rows[: _n_spread(n, model.p)]) for n in counts]

    def loss_off_quadratics(self) -> float:
        """Mean loss of the budget on surfaces drawn from the prior of the process; nan of more than 250 runs.

        They vary as much as the quadratics that are known. After a start design runs lie at optima of draws from what
        is known so far, by the very process that made the surface: what learning its lengths takes is left out.
        """
        runs, rng = self.rule.max_runs, generator(self.seed, 0, "budget: processes")
        points = self._cloud[:: -(-len(self._cloud) // _PLACES)]
        Z, losses = self.known.model.matrix(points), []
        variance = float(np.mean(np.var(Z @ self.known.coefficients.T, axis=0)))
        if runs > MOST_SETTINGS or not variance > 0.0:
            return float("nan")
        noise = math.hypot(self.known.noise, math.sqrt(_NUGGET * variance))
        start = _greedy(Z, min(Z.shape[1] + _EXTRA, runs))
        together = max(_TOGETHER, -(-(runs - len(start)) // _BATCHES))
        for covariance in prior_covariances(self.known.model, points, N_CAMPAIGNS, rng):
            covariance *= variance / (np.mean(np.diag(covariance)) - np.mean(covariance))
            root = np.linalg.cholesky(covariance + _NUGGET * variance * np.eye(len(points)))
            truth = root @ rng.standard_normal(len(points))
            covariance += 100.0 * variance  # of the constant, which is not known
            at, scores = start, truth[start] + noise * rng.standard_normal(len(start))
            while True:
                across = covariance[at]
                own = across[:, at] + noise**2 * np.eye(len(at))
                if len(at) == runs:
                    break
                # Draws without scores, moved by what the scores say (as `Process.draw`).
                before = root @ rng.standard_normal((len(points), min(together, runs - len(at))))
                errors = noise * rng.standard_normal((len(at), before.shape[1]))
                moved = before + across.T @ np.linalg.solve(own, scores[:, None] - before[at] - errors)
                new = np.argmax(moved, axis=0).tolist()
                at, scores = at + new, np.append(scores, truth[new] + noise * rng.standard_normal(len(new)))
            losses.append(truth.max() - truth[np.argmax(across.T @ np.linalg.solve(own, scores))])
        return float(np.mean(losses))

    @cached_property
    def _cloud(self) -> FloatArray:
        return _cloud(self.region, self.known.model.p, generator(self.seed, 0, "budget: settings"))

    @cached_property
    def _best(self) -> FloatArray:
        """What could be had of each truth, the goal's sign to it."""
        truth = self.known.scores(self.known.model.matrix(self._cloud) @ self.known.coefficients.T)
        return np.asarray((sign_of(self.goal) * truth).max(axis=0))

    def _plan(self, change: str, n: int, p: int, Z: FloatArray, truth: FloatArray, rows: list[int]) -> Plan:
        """One number of runs ``n``: ``rows`` of ``Z`` are those that are spread, the others gather at the best."""
        terms = p + self.constants
        asked = max(self.rule.min_runs(terms), terms + 1)
        sign, noise, n_spread, m = sign_of(self.goal), self.known.noise, len(rows), n - len(rows)
        if n <= terms or np.linalg.matrix_rank(Z[rows]) < p:
            return Plan(change, n, p, asked, float("nan"), float("nan"))
        # The first runs of every number are the same, so that numbers differ by what more runs give.
        spread, repeats = (generator(self.seed, 0, f"budget: {kind} runs") for kind in ("spread", "repeated"))
        every, scatter = np.arange(truth.shape[1]), self.known.scatter(truth)
        # Over the scatter in score units: by its square runs count on the scale of the fit.
        slope = self.known.slope(truth) / scatter
        own, root = Z[rows], slope[rows]
        y = truth[rows] + noise / root * spread.standard_normal((n_spread, len(every)))
        weighted = own * root.T[:, :, None]  # (campaigns, runs, terms); one for all campaigns where they weigh alike
        turned = np.swapaxes(weighted, 1, 2)
        inverse = np.linalg.inv(turned @ weighted)
        beta = (inverse @ (turned @ (y * root).T[:, :, None]))[..., 0].T
        rss = np.sum((root * (y - own @ beta)) ** 2, axis=0)
        fitted, through = Z @ beta, Z @ inverse
        h = np.broadcast_to(np.sum(through * Z, axis=2).T, truth.shape)
        slope, scatter = (np.broadcast_to(each, truth.shape) for each in (slope, scatter))
        if m:  # repeats at the best settings so far: one more observation of weight m there, and their own scatter
            at = np.argmax(sign * fitted, axis=0)
            there, each = slope[at, every], noise * repeats.standard_normal((m, len(every)))
            apart = truth[at, every] + each.mean(axis=0) / there - fitted[at, every]
            gain = m * there**2 / (1.0 + m * there**2 * h[at, every])
            across = (through @ Z[at][:, :, None])[..., 0].T
            fitted, h = fitted + across * (gain * apart), h - across**2 * gain
            rss = rss + np.sum((each - each.mean(axis=0)) ** 2, axis=0) + apart**2 * gain
        at = np.argmax(sign * fitted, axis=0)
        rule, ratio = replace(self.rule, max_runs=n), self.known.at_best
        h_there = h[at, every] * (slope[at, every] / ratio) ** 2
        width = rule.width(ratio * scatter[at, every] * np.sqrt(rss / (n - p)), n - terms, h_there)
        loss = np.maximum(self._best - sign * self.known.scores(truth[at, every]), 0.0)
        return Plan(change, n, p, asked, float(np.median(width)), float(np.mean(loss)))


def plans_by_process(analysis: Analysis, rule: StopRule, seed: int) -> tuple[tuple[Plan, ...], tuple[Plan, ...]]:
    """What `Budget.plans` gives of the campaign as it is, by a process that the scores favour over the quadratic.

    For the loss runs lie where they would be proposed by what is known now. Surfaces are drawn from the process, and
    each is learnt from its own scores of these runs, beside those so far; only what the process rests on stays. The
    half-width is that of `forecast`, which interim analyses tell of, too.
    """
    fitted, n_made, p = analysis.fitted, analysis.fit.n_runs, analysis.model.p
    process, region, made, best = fitted.departure.process, fitted.region, fitted.data.points, analysis.optimum.point
    assert process is not None
    terms, sign, key = fitted.surface.n_terms, sign_of(fitted.goal), batch_seed(seed, n_made)
    asked = rule.min_runs(terms)
    counts = [n for n in _counts(rule.max_runs, [asked]) if n > n_made or n == rule.max_runs]
    runs = Runs(made, np.zeros(n_made, dtype=np.bool_))
    further = propose_from_process(process, region, best, runs, max(counts[-1] - n_made, 0), sign=sign, seed=key)
    cloud, rng = cloud_of(process, region, best, made, sign, key)
    places = [int(np.argmin(np.sum(np.square(cloud.points - one.point), axis=1))) for one in further]
    s, h = fitted.scatter(best)
    truth = cloud.draws(N_CAMPAIGNS // FEW, rng)
    scores = truth[:, places] + s * rng.standard_normal((len(truth), len(places)))
    each, found = np.arange(len(truth)), {}
    for n in counts:
        at = places[: max(n - n_made, 0)]
        across = cloud.covariance[at]
        gain = np.linalg.solve(across[:, at] + s**2 * np.eye(len(at)), across)
        chosen = np.argmax(cloud.mean + (scores[:, : len(at)] - cloud.mean[at]) @ gain, axis=1)
        top, here = (fitted.scale.to_score(sign * value) for value in (truth.max(axis=1), truth[each, chosen]))
        ahead = forecast(replace(rule, max_runs=n), n_runs=n_made, n_terms=terms, s=analysis.sd_of_run, h=h)
        found[n] = Plan("", n, p, asked, ahead.attainable_half_width, float(np.mean(sign * (top - here))))
    return (found[rule.max_runs],), tuple(found.values())


def _counts(budget: int, asked: Sequence[int]) -> list[int]:
    """Numbers of runs that are told of: the budget, what models ask for, and more."""
    return sorted({budget, *asked, *(int(np.ceil(share * max(asked))) for share in (1.5, 2.0, 3.0))})


def _n_spread(n: int, p: int) -> int:
    """Runs of ``n`` that are spread over the region; the others repeat the best settings so far."""
    return min(n, p + _EXTRA) + max(n - p - _EXTRA, 0) // 2


def _cloud(region: Region, p: int, rng: np.random.Generator) -> FloatArray:
    """Feasible settings that runs are taken from and optima sought in (m, k)."""
    size = max(_LEAST_CLOUD, 12 * p)
    corners = region.candidates(3, 4 * size)
    if len(corners) > size:
        corners = corners[rng.choice(len(corners), size, replace=False)]
    return np.vstack([corners, region.sample(size // 2, rng)])


def _greedy(Z: FloatArray, n: int) -> list[int]:
    """Rows that tell the terms well: each adds most to the determinant."""
    ridge = 1e-6
    inverse = np.eye(Z.shape[1]) / ridge
    rows = []
    for _ in range(n):
        h = np.einsum("ij,jk,ik->i", Z, inverse, Z)
        i = int(np.argmax(h))
        v = inverse @ Z[i]
        inverse = inverse - np.outer(v, v) / (1.0 + h[i])
        rows.append(i)
    return rows
