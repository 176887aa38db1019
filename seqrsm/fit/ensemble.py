"""Ensemble sampling of the posterior with emcee, run until its own convergence rule holds or refused.

Several independent ensembles advance together in one emcee sampler. Half of the moves are independence proposals from
a normal-inverse-gamma distribution, the others differential evolution and snooker moves. For normal errors and a
conjugate prior that distribution is the exact posterior (``seqrsm.fit.conjugate``), and the sampler can be checked
against it; otherwise it is fitted to a pilot run that is then forgotten.

References
----------
Foreman-Mackey et al. (2013), emcee: the MCMC hammer, PASP 125, 306-312.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np

from seqrsm.arrays import FloatArray
from seqrsm.errors import ConvergenceError, FitError
from seqrsm.fit import convergence
from seqrsm.fit.moves import DifferentialMove, Distribution, IndependenceMove, Move, SnookerMove
from seqrsm.fit.target import Target
from seqrsm.progress import tell

# scipy.stats takes longer to load than a campaign's posterior to sample. emcee has one move, not used here, that wants
# it: the module of that move is loaded when somebody else in this process makes one.
_KDE = ModuleType("emcee.moves.kde")
_KDE.KDEMove = lambda *args, **options: import_module(_KDE.__name__).KDEMove(*args, **options)  # type: ignore[attr-defined]
if "emcee" not in sys.modules:
    sys.modules[_KDE.__name__] = _KDE
import emcee  # noqa: E402

if sys.modules.get(_KDE.__name__) is _KDE:
    del sys.modules[_KDE.__name__]

_FIRST_BLOCK = 200
_PILOT = 300  # steps that tune the independence proposal and are then forgotten
_TAUS = 50.0  # steps kept must exceed this many autocorrelation times
_BURN_TAUS = 5.0
_R_HAT = 1.01
_TOLD_EVERY = 20  # stored steps
_STORE_BYTES = 96 * 2**20  # beyond this every second stored step is dropped
_STORED_STEPS = 256  # that there is always room for: where coefficients are many, of fewer walkers
_TAU_WALKERS = 128  # walkers that the autocorrelation time is averaged over
_R_HAT_DRAWS = 2000  # draws of each ensemble that R-hat is computed from

WALKERS, ENSEMBLES = 128, 4
"""Of each of the independent ensembles, raised to twice the dimensions where that is more; both even."""
MIN_ESS = 4000.0
"""Effective draws of every coordinate asked for, among those handed out."""
MAX_DRAWS, MAX_STEPS = 50_000, 20_000
"""Bounds on what is handed out and on the work [steps of every walker]; a posterior near normal takes a tenth."""


@dataclass(frozen=True, slots=True)
class Sampled:
    """Draws of a model's parameters, and the evidence that they are from the posterior."""

    draws: FloatArray
    """(m, d): in the parameters' own units; of a linear model coefficients, then the standard deviation (scale, for
    Student-t errors) of a run of weight 1, where whitened coefficients and log sigma were sampled."""
    tau: FloatArray
    """(d,): integrated autocorrelation time of every coordinate that was sampled [steps]."""
    ess: FloatArray
    """(d,): effective sample size of every coordinate among the draws handed out."""
    r_hat: FloatArray
    """(d,): rank-normalised split R-hat across the independent ensembles."""
    ess_ends: FloatArray
    """(d,): effective sample size of the ends of the 95 % interval, the smaller of the two, of every parameter."""
    acceptance: dict[str, float]
    """Accepted share by move."""
    steps: int
    """Made by every walker."""


@dataclass(slots=True)
class _Reached:
    """Where a run stands."""

    tau: FloatArray
    r_hat: FloatArray
    ess: FloatArray
    kept: FloatArray
    long_enough: bool


class _Chain:
    """The sampler with its store: every ``thin``-th step, thinned further when memory runs short, of some walkers."""

    def __init__(self, target: Target, seed: int) -> None:
        self._target = target
        self._n = ENSEMBLES * max(WALKERS, 2 * target.d)
        self._every = -(-_STORED_STEPS * 8 * self._n * target.d // _STORE_BYTES)
        random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(seed)))
        start = target.start(random, self._n)
        log_prob = target.log_prob(start)
        if not np.all(np.isfinite(log_prob)):
            raise FitError("the posterior density is not finite where it is expected to lie")
        self._state = emcee.State(start, log_prob=log_prob, random_state=random.get_state())
        self._start([target.proposal], [1.0])
        if not target.exact:
            self.advance(_PILOT, _PILOT)
            late = self.stored[_PILOT // 2 :: 10].reshape(-1, target.d)
            self._start([target.proposal.tuned(late), target.proposal], [0.8, 0.2])

    def _start(self, proposals: list[Distribution], shares: list[float]) -> None:
        """Begin to count afresh from the present state, with these independence proposals from now on."""
        self.moves: dict[str, Move] = {
            "independence": IndependenceMove(proposals, shares),
            "differential evolution": DifferentialMove(ENSEMBLES),
            "snooker": SnookerMove(ENSEMBLES),
        }
        moves = list(zip(self.moves.values(), (0.5, 0.3, 0.2), strict=True))
        self._sampler = _sampler(self._n, self._target.d, self._target.log_prob, moves)
        self.stored = np.empty((0, *self._kept().shape))
        self.thin = 1
        self.steps = 0

    def advance(self, steps: int, wanted: int) -> None:
        """Make about ``steps`` more steps on the way to so many ``wanted`` in all."""
        limit = _STORE_BYTES // (8 * self.stored.shape[1] * self.stored.shape[2])
        while (self.stored.shape[0] + steps // self.thin) > limit:
            self.stored = self.stored[1::2].copy()
            self.thin *= 2
        block = []
        iterations = max(steps // self.thin, 1)
        for state in self._sampler.sample(
            self._state, iterations=iterations, thin_by=self.thin, store=False, skip_initial_state_check=self.steps > 0
        ):
            self._state = state
            block.append(self._kept())
            if len(block) % _TOLD_EVERY == 0:
                tell("sampling the posterior", self.steps + len(block) * self.thin, wanted)
        self.steps += len(block) * self.thin
        self.stored = np.concatenate([self.stored, np.stack(block)])

    def _kept(self) -> FloatArray:
        """Coordinates (w, d) of the walkers that are stored, of every ensemble as many."""
        d = self._target.d
        some = self._state.coords.reshape(ENSEMBLES, -1, d)[:, :: self._every]
        return np.array(some.reshape(-1, d))

    def judge(self) -> _Reached:
        """Autocorrelation time, R-hat and effective sample size of what is stored so far."""
        n, walkers, d = self.stored.shape
        some = np.linspace(0, walkers - 1, min(_TAU_WALKERS, walkers)).astype(np.int64)
        tau = convergence.autocorrelation_time(self.stored[:, some])
        largest = float(np.max(tau))
        burn = min(int(np.ceil(_BURN_TAUS * largest)), n // 2) if np.isfinite(largest) else n // 2
        after = self.stored[burn:]
        stride = max(int(largest / 2.0) if np.isfinite(largest) else 1, -(-after.shape[0] * walkers // MAX_DRAWS), 1)
        kept = after[::-1][::stride][::-1]
        kept_tau = np.maximum(convergence.autocorrelation_time(kept[:, some]), 1.0)
        ess = kept.shape[0] * walkers / kept_tau
        long_enough = after.shape[0] > _TAUS * largest and kept.shape[0] >= 4
        chains = after.reshape(after.shape[0], ENSEMBLES, -1, d)
        every = max(after.shape[0] * chains.shape[2] // _R_HAT_DRAWS, 1)
        # Ensembles x draws in the order of time, every so many of them.
        draws = np.moveaxis(chains, 1, 0).reshape(ENSEMBLES, -1, d)[:, ::every]
        r_hat = np.array([convergence.r_hat(draws[:, :, j]) for j in range(d)])
        return _Reached(tau * self.thin, r_hat, ess, kept, long_enough)


def _sampled(chain: _Chain, reached: _Reached, target: Target) -> Sampled:
    """What a run gives, walkers as chains."""
    draws = target.unpack(reached.kept.reshape(-1, target.d))
    chains = draws.reshape(len(reached.kept), -1, target.d)
    ends = [convergence.ess_tail(chains[:, :, j].T, (0.025, 0.975)) for j in range(target.d)]
    return Sampled(
        draws=draws,
        tau=reached.tau,
        ess=reached.ess,
        r_hat=reached.r_hat,
        ess_ends=np.array(ends),
        acceptance={name: move.accepted / max(move.proposed, 1) for name, move in chain.moves.items()},
        steps=chain.steps,
    )


def sample(target: Target, seed: int) -> Sampled:
    """Sample until the convergence rule holds; the same seed gives the same draws, whatever numpy's random state.

    The rule: after the first 5 tau steps are discarded, more than 50 tau remain, every coordinate has `MIN_ESS`
    effective draws among those handed out, and R-hat across ensembles is at most 1.01. ConvergenceError, with steps,
    tau, R-hat and ess reached, where the rule would ask for more than `MAX_STEPS`; FitError where the density is not
    finite where it was expected to lie.
    """
    chain = _Chain(target, seed)
    block = _FIRST_BLOCK
    while True:
        steps = min(block, MAX_STEPS - chain.steps)
        chain.advance(steps, chain.steps + steps)
        reached = chain.judge()
        tau, r_hat, ess = float(np.max(reached.tau)), float(np.max(reached.r_hat)), float(np.min(reached.ess))
        if reached.long_enough and ess >= MIN_ESS and r_hat <= _R_HAT:
            return _sampled(chain, reached, target)
        needed = (_TAUS + _BURN_TAUS) * tau  # of few steps tau is told too small, not too large
        if chain.steps >= MAX_STEPS or (np.isfinite(tau) and needed > MAX_STEPS):
            raise ConvergenceError(
                f"the sampler stopped after {chain.steps} of at most {MAX_STEPS} steps: autocorrelation time {tau:.3g} "
                f"steps (the rule asks for more than {_TAUS:.0f} of them), {ess:.0f} of {MIN_ESS:.0f} effective draws, "
                f"R-hat {r_hat:.4f}"
            )
        # Straight to the length that the present estimate of tau asks for, with a margin, but no leaps of faith.
        wanted = int(1.1 * needed) - chain.steps if np.isfinite(tau) else block
        block = int(np.clip(wanted, _FIRST_BLOCK // 2, 2 * chain.steps))


def _sampler(n: int, d: int, log_prob: Callable[[FloatArray], FloatArray], moves: list[Any]) -> Any:
    """An emcee sampler of ``n`` walkers in ``d`` coordinates."""
    found = emcee.EnsembleSampler(n, d, log_prob, moves=moves, vectorize=True)
    found.log_prob_fn = log_prob  # without emcee's wrapper, which prints a traceback where the user presses Ctrl-C
    return found
