"""Laws fitted to weighted samples of earlier plans: path integral cross-entropy (Kappen and Ruiz 2016).

Under the optimal law all samples of a class weigh the same, and at every state its control is the mean of what weighted
samples apply there. So the noise of samples is regressed on the deviation from the nearest row of a guide, on top of
the guide's law. The sums of this regression are kept from plan to plan, about the rows of the last guide, and fade. The
prior is the guide's law, and neighbouring rows share what was learned.

Few samples carry nearly all weight, and a fit to them alone follows their noise. Weights w are therefore raised to a
power a up to 1. Since w^a - 1 is about a log w, that fit is a times as far from the law that was followed as the
optimum is. So survivors count (1 - 1/a) + w^a / a, normalised, and the power with the least noise is taken. A plan is
sampled under what earlier plans have learned: its likelihood ratios are exact, and psi stays unbiased.
"""

from dataclasses import dataclass, replace

import numpy as np

from pirrht.arrays import Array, IntArray
from pirrht.jit.jit import inlined, kernel
from pirrht.proposals.guide import DDPGuide
from pirrht.proposals.tuning import TUNING, ProposalTuning
from pirrht.systems.dynamics import wrapped


@inlined
def _off(x, reference, angles, out):  # type: ignore[no-untyped-def]
    """Write the deviation of a state x (n,) from that of a row to out[1:]."""
    for k in range(x.shape[0]):
        apart = x[k] - reference[k]
        out[k + 1] = wrapped(apart) if (angles >> k) & 1 else apart


@inlined
def _square(off, metric):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(metric.shape[0]):
        total += metric[k] * off[k + 1] * off[k + 1]
    return total


@kernel
def regress(paths, counts, steps, rows, metric, angles, timed, products, sums):  # type: ignore[no-untyped-def]
    """Add paths to the sums of a regression of their noise on (1, x - x_ref) at their nearest row.

    Args, in order: states (c, T+1, n) and a applied by steps (c, T, m) [1/sqrt(s)] of the paths, what they count among
        states and in noise (c, 2), steps taken (c,) of which the last ends within; states of the rows (L, n), with the
        law there (L, n+1, m), metric (n,), bit k tells whether the k-th state is a heading, whether the row that is due
        counts instead of the nearest; sums (L, n+1, n+1) and (L, n+1, m), the latter of the noise on top of the law.
    """
    (states, asked), (reference, law) = paths, rows
    (c, _, m), (L, n) = asked.shape, reference.shape
    z = np.ones(n + 1)
    other = np.ones(n + 1)

    for s in range(c):
        r = 0
        for i in range(steps[s] - 1):
            r = min(i if timed else r + (1 if i > 0 else 0), L - 1)
            _off(states[s, i], reference[r], angles, z)
            here = _square(z, metric)
            for step in (1, -1):
                while not timed and 0 <= r + step < L:
                    _off(states[s, i], reference[r + step], angles, other)
                    there = _square(other, metric)
                    if there >= here:
                        break
                    r, here = r + step, there
                    z[:] = other
            if r == L - 1:  # beyond it samples home in on the goal
                break
            for j in range(n + 1):
                for k in range(n + 1):
                    products[r, j, k] += counts[s, 0] * z[j] * z[k]
            for k in range(m):
                noise = asked[s, i, k]
                for j in range(n + 1):
                    noise -= law[r, j, k] * z[j]
                for j in range(n + 1):
                    sums[r, j, k] += counts[s, 1] * noise * z[j]


@dataclass(eq=False)
class LawFit:
    """Law around the guide of one class, as samples of earlier plans tell it."""

    guide: DDPGuide
    products: Array  # (L, n+1, n+1) sums of weight times (1, x - x_ref)(1, x - x_ref)', by row of the guide
    sums: Array  # (L, n+1, m) the same of (1, x - x_ref) times a' less the guide's law
    tuning: ProposalTuning = TUNING
    learned: DDPGuide | None = None  # the guide with the law; None: samples have come since

    @classmethod
    def of(cls, guide: DDPGuide, tuning: ProposalTuning = TUNING) -> "LawFit":
        """Begin around a guide."""
        n, m = guide.dynamics.n, guide.dynamics.m
        return cls(guide, np.zeros((guide.length, n + 1, n + 1)), np.zeros((guide.length, n + 1, m)), tuning)

    def carried(self, guide: DDPGuide, elapsed: float, *, timed: bool) -> "LawFit":
        """Return it around another guide of the class, some time [s] later; rows without a near one are forgotten.

        Each row goes to the nearest one, or if `timed` to the one that is due, unless that is farther than a step.
        """
        new = LawFit.of(guide, self.tuning)
        d = guide.dynamics
        before = self.guide.states[: len(self.products)]

        states = guide.states[: len(new.products)]
        if timed:  # between two rows, both have a share
            due = self.guide.times[: len(before)] - elapsed
            at = np.where(due > -1e-9, np.interp(due, guide.times, np.arange(len(guide.times))), -1.0)
            first = np.floor(at + 1e-6).astype(np.int64)
            later = np.clip(at - first, 0.0, 1.0)
            targets = [(first, 1.0 - later), (first + 1, later)]
        else:
            apart = (guide.metric * d.difference(before[:, None], states) ** 2).sum(axis=2)
            targets = [(np.argmin(apart, axis=1), np.ones(len(before)))]
        for row, share in targets:
            here = np.clip(row, 0, len(states) - 1)
            off = d.difference(before, states[here])
            pace = (guide.metric * d.difference(guide.states[here + 1], states[here]) ** 2).sum(axis=1)
            near = (row == here) & ((guide.metric * off**2).sum(axis=1) <= pace)
            weight = np.where(near, share, 0.0)[:, None, None]
            shift = np.tile(np.eye(d.n + 1), (len(row), 1, 1))
            shift[:, 1:, 0] = off
            np.add.at(new.products, here, weight * (shift @ self.products @ np.swapaxes(shift, 1, 2)))
            np.add.at(new.sums, here, weight * (shift @ self.sums))
        return new

    def fade(self) -> None:
        """Forget some of it, before a plan adds its samples."""
        self.products[:] *= self.tuning.fit_memory
        self.sums[:] *= self.tuning.fit_memory

    def learn(self, paths: tuple[Array, Array, IntArray], counts: Array, followed: DDPGuide, *, timed: bool) -> None:
        """Add samples that count so much (c, 2): states (c, T+1, n), a by steps (c, T, m) and steps taken (c,).

        Their noise is on top of the law that a guide around the same trajectory has, which they followed.
        """
        states, asked, steps = paths

        L = len(self.products)
        headings = sum(1 << i for i in self.guide.dynamics.angles)
        law = self._rows(followed)

        products = np.zeros_like(self.products)
        sums = np.zeros_like(self.sums)
        rows = self.guide.states[:L], law
        regress((states, asked), counts, steps, rows, self.guide.metric, headings, timed, products, sums)
        self.products[:] += products
        self.sums[:] += sums + products @ (law - self._rows(self.guide))
        self.learned = None

    @property
    def followed(self) -> DDPGuide:
        """The guide with the law that was learned: one and the same until there are more samples."""
        if self.learned is None:
            self.learned = self._solved()
        return self.learned

    def _solved(self) -> DDPGuide:
        """Solve for the law."""
        guide, (L, p, m) = self.guide, self.sums.shape
        A = pooled(self.products, self.tuning.fit_rows)
        B = pooled(self.sums, self.tuning.fit_rows)
        count = np.maximum(A[:, 0, 0], 1e-9)
        ridge = (self.tuning.fit_prior / np.diff(guide.times)[:L] / count)[:, None] * np.einsum("lii->li", A)
        change = np.linalg.solve(A + np.maximum(ridge, 1e-12)[:, :, None] * np.eye(p), B)
        modes = guide.modes.copy()
        gains = guide.gains.copy()
        modes[:L, :m] += change[:, 0]
        gains[:L, :m] += np.swapaxes(change[:, 1:], 1, 2)
        return replace(guide, modes=modes, gains=gains)

    def _rows(self, guide: DDPGuide) -> Array:
        """Return the law of a guide by row (L, n+1, m), as what (1, x - x_ref) is multiplied by."""
        L, _, m = self.sums.shape
        return np.concatenate([guide.modes[:L, None, :m], np.swapaxes(guide.gains[:L, :m], 1, 2)], axis=1)


def pooled(sums: Array, rows: int) -> Array:
    """Add to sums by row (L, ...) those of neighbouring rows, less and less of them."""
    total = sums.copy()
    for k in range(1, min(rows, len(sums) - 1) + 1):
        share = 1.0 - k / (rows + 1.0)
        total[k:] += share * sums[:-k]
        total[:-k] += share * sums[k:]
    return total


def chosen(log_weight: Array, log_share: Array, most: int, tuning: ProposalTuning = TUNING) -> tuple[IntArray, Array]:
    """Choose samples from which a law is fitted (c,), and what they count among states and in noise (c, 2).

    Args: log dP*/dQ of survivors (S,), Q being the law that was followed, and log dQ/dM, M being the mixture that they
        were drawn from, both up to a constant [nats]; how many are drawn, in proportion to what they count.
    """
    base = np.exp(log_share - log_share.max())
    relative = log_weight - log_weight.max()
    base /= base.sum()
    best, power, weight = 0.0, 1.0, base
    for one in tuning.fit_powers:
        raised = np.exp(log_share + one * relative - np.max(log_share + one * relative))
        raised /= raised.sum()
        precision = one**2 / float((raised**2).sum())
        if precision > best:
            best, power, weight = precision, one, raised
    signed = base + (weight - base) / power
    size = np.abs(signed)
    total = float(size.sum())
    number = np.diff(np.floor(np.cumsum(size) / total * most + 0.5), prepend=0.0)
    found = np.flatnonzero(number)
    worth = 1.0 / float((signed**2).sum())
    counts = worth * number[found, None] / most * np.column_stack([np.ones(len(found)), total * np.sign(signed[found])])
    return found, counts
