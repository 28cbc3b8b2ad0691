"""Sample adhesions given the vectors: how many there are, where, and how wide. Their forces follow in closed form.

    vectors = sum of responses to forces of blobs + drift + noise

Given the scales of the blobs, forces are Gaussian and are integrated out. A Markov chain samples the rest: blobs are
born and die (P. J. Green, Biometrika 82, 1995, 711-732), move, and change in size and scale. Traction has a similar
magnitude across a cell, so that the prior of a blob's force is proportional to its area, within a factor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg

from palpate.elastic.pad import Floats
from palpate.microscopy.blobs import Response
from palpate.microscopy.vectors import Vectors

__all__ = ["Chain", "Places"]

#: Expected number of blobs, and the largest.
COUNT, MOST = 15.0, 60
#: Prior standard deviations: of log traction from blob to blob, and of log size about the middle size. Adhesions of 0.4
#: to 3 um are blobs of 0.1 to 0.8 um.
TRACTION, SIZE = 0.8, 0.5
#: Prior standard deviation of a drift, as a multiple of the root mean square of the vectors.
DRIFT = 10.0
#: Standard deviation of outliers' offsets as a multiple of the largest displacement of the other vectors, and number of
#: steps after which a switch is tried.
OUTLYING, DOUBT = 2.0, 3
#: Distance of a blob from the vector whose offset it replaces: standard deviation in pitches.
NEAR = 0.5
#: Increase of the log evidence from which a blob is added or kept when a chain starts.
WORTH = 3.0
#: Probability of each kind of step: birth, death, move, change of size, change of scale. Otherwise the step moves a
#: blob by about a pitch.
BIRTH, DEATH, MOVE, RESIZE, RESCALE = 0.15, 0.15, 0.32, 0.18, 0.10
#: Standard deviations of steps: of log size, of log scale and of log noise. A step of the noise is tried every EVERY
#: steps.
SIZE_STEP, SCALE_STEP, NOISE_STEP, EVERY = 0.4, 0.6, 0.03, 10


@dataclass(frozen=True, eq=False)
class Places:
    """Where blobs may be: densities [1/m^2] on squares of side ``pitch`` [m], ``margin`` of them before the first
    vector. ``prior`` is the prior density, ``proposal`` the one from which births draw.
    """

    prior: Floats
    proposal: Floats
    margin: tuple[int, int]
    pitch: float

    def __post_init__(self) -> None:
        sums = np.cumsum(self.proposal.ravel())
        object.__setattr__(self, "_sums", sums / sums[-1])

    def drawn(self, rng: np.random.Generator) -> tuple[float, float]:
        """Draw a place from the proposal."""
        sums: Any = self._sums  # type: ignore[attr-defined]
        row, column = divmod(int(np.searchsorted(sums, rng.random())), self.prior.shape[1])
        x, y = (n - m + rng.random() - 0.5 for n, m in ((column, self.margin[1]), (row, self.margin[0])))
        return self.pitch * x, self.pitch * y

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the densities of prior and proposal at a place; 0 outside."""
        row, column = round(y / self.pitch) + self.margin[0], round(x / self.pitch) + self.margin[1]
        if not (0 <= row < self.prior.shape[0] and 0 <= column < self.prior.shape[1]):
            return 0.0, 0.0
        return float(self.prior[row, column]), float(self.proposal[row, column])


class Chain:
    """One Markov chain. ``blobs`` (blob, 4): x, y [m], log of size [m], log of the scale of the force [N]."""

    def __init__(
        self,
        vectors: Vectors,
        response: Response,
        places: Places,
        sizes: tuple[float, float, float],
        noise: float,
        *,
        known: bool,
        least_noise: float = 0.0,
        drift: bool = True,
        odds: float = 0.0,
        rng: np.random.Generator,
    ) -> None:
        self.vectors, self.response, self.places, self.rng = vectors, response, places, rng
        self.least, self.middle, self.largest = (math.log(s) for s in sizes)
        self.noise, self.known, self.least_noise = noise, known, least_noise
        #: Log of the typical traction [Pa].
        self.level = 0.0
        q = self.fixed = len(vectors.patterns)
        room = q + 2 * MOST
        self.rows = np.zeros((room, len(vectors.y)))
        self.gram, self.linear = np.zeros((room, room)), np.zeros(room)
        self.rows[:q] = vectors.patterns
        self.gram[:q, :q], self.linear[:q] = vectors.patterns @ vectors.patterns.T, vectors.patterns @ vectors.y
        self.count = q
        self.power = float(vectors.y @ vectors.y)
        size = math.sqrt(self.power / max(len(vectors.y), 1))
        #: Prior standard deviation of drift, and of offsets of the doubtful vectors that are currently outliers.
        self.scales = np.zeros(q)
        self.scales[:3] = float(drift) * DRIFT * size
        self.wrong = np.zeros(len(vectors.doubtful), dtype=bool)
        #: Log prior odds that a doubtful vector is an outlier.
        self.odds = odds
        normal = np.delete(vectors.values, np.array(vectors.doubtful, dtype=int), axis=1)
        self.offset = OUTLYING * float(np.abs(normal).max(initial=0.0))
        self.blobs: Floats = np.zeros((0, 4))
        self.evidence = self._evidence(self.gram, self.linear, self.blobs, self.noise)

    # -- evidence of blobs

    def _factor(
        self, gram: Floats, linear: Floats, blobs: Floats, noise: float
    ) -> tuple[Floats, Floats, Floats] | None:
        """Return L, L^-1 b and the scales. L is the lower Cholesky factor of the posterior precision of the unknowns that
        are not fixed, each divided by its scale (its prior standard deviation); b is the scaled right side.
        """
        count = self.fixed + 2 * len(blobs)
        scale = np.concatenate([self.scales, np.repeat(np.exp(blobs[:, 3]), 2)])
        gram, linear = gram[:count, :count], linear[:count]
        if not self.wrong.all():  # offsets of normal vectors are zero
            used = self._used(count)
            gram, linear, scale = gram[np.ix_(used, used)], linear[used], scale[used]
        precision = gram * (scale[:, None] * scale / noise**2)
        precision[np.diag_indices(len(scale))] += 1.0
        lower, failed = scipy.linalg.lapack.dpotrf(precision, lower=1, overwrite_a=1, clean=1)
        if failed:
            return None
        return lower, scipy.linalg.blas.dtrsv(lower, scale * linear, lower=1), scale

    def _used(self, count: int) -> npt.NDArray[np.intp]:
        """Return the indices of those of ``count`` unknowns that are not fixed at zero."""
        used = np.ones(count, dtype=bool)
        used[3 : self.fixed] = np.repeat(self.wrong, 2)
        return np.flatnonzero(used)

    def _evidence(self, gram: Floats, linear: Floats, blobs: Floats, noise: float) -> float:
        """Return the log evidence of blobs, with their forces integrated out."""
        factor = self._factor(gram, linear, blobs, noise)
        if factor is None:
            return -math.inf
        lower, right, _ = factor
        squares = self.power / noise**2 - float(right @ right) / noise**4
        log_determinant = 2.0 * float(np.log(np.diag(lower)).sum()) + 2.0 * len(self.vectors.y) * math.log(noise)
        return -0.5 * (squares + log_determinant)

    def _prior(self, blob: Floats) -> float:
        """Return the log prior of a blob."""
        x, y, size, scale = blob
        density = self.places.at(x, y)[0]
        if not self.least <= size <= self.largest or not density > 0:
            return -math.inf
        return math.log(density) - 0.5 * (
            ((size - self.middle) / SIZE) ** 2 + (self._traction(scale, size) / TRACTION) ** 2
        )

    def _traction(self, scale: Any, size: Any) -> Any:
        """Return the log of the traction that a blob's scale implies, relative to the typical one. A blob of size s
        counts as a disc of radius 2 s.
        """
        return scale - self.level - math.log(4 * math.pi) - 2 * size

    # -- steps

    def _response_of(self, blob: Floats) -> Floats:
        return self.vectors.rows(self.response, float(blob[0]), float(blob[1]), math.exp(blob[2]))

    def _with(self, k: int, rows: Floats) -> tuple[Floats, Floats]:
        """Return the normal matrix and right side with the rows of blob ``k`` replaced or, for a new ``k``, appended."""
        at = self.fixed + 2 * k
        count = max(self.count, at + 2)
        gram, linear = self.gram[:count, :count].copy(), self.linear[:count].copy()
        across = rows @ self.rows[: self.count].T
        gram[at : at + 2, : self.count], gram[: self.count, at : at + 2] = across, across.T
        gram[at : at + 2, at : at + 2] = rows @ rows.T
        linear[at : at + 2] = rows @ self.vectors.y
        return gram, linear

    def _take(self, k: int, rows: Floats, gram: Floats, linear: Floats, blobs: Floats, evidence: float) -> None:
        at, count = self.fixed + 2 * k, len(linear)
        self.rows[at : at + 2] = rows
        self.gram[:count, :count], self.linear[:count] = gram, linear
        self.count, self.blobs, self.evidence = count, blobs, evidence

    def _without(self, k: int) -> tuple[npt.NDArray[np.intp], Floats, float]:
        """Return, for the state without blob ``k``: the indices that remain, the blobs that remain, and the evidence."""
        at = self.fixed + 2 * k
        stay = np.concatenate([np.arange(at), np.arange(at + 2, self.count)])
        blobs = np.delete(self.blobs, k, axis=0)
        return stay, blobs, self._evidence(self.gram[np.ix_(stay, stay)], self.linear[stay], blobs, self.noise)

    def _leave(self, stay: npt.NDArray[np.intp], blobs: Floats, evidence: float) -> None:
        count = len(stay)
        self.rows[:count], self.linear[:count] = self.rows[stay], self.linear[stay]
        self.gram[:count, :count] = self.gram[np.ix_(stay, stay)]
        self.count, self.blobs, self.evidence = count, blobs, evidence

    def _accepts(self, gain: float) -> bool:
        return math.log(1.0 - self.rng.random()) < gain

    def _changed(self, k: int, blob: Floats) -> None:
        """Propose ``blob`` in place of blob ``k``, and accept or reject it."""
        prior = self._prior(blob) - self._prior(self.blobs[k])
        if not math.isfinite(prior):
            return
        blobs = self.blobs.copy()
        blobs[k] = blob
        if np.array_equal(blob[:3], self.blobs[k, :3]):
            evidence = self._evidence(self.gram, self.linear, blobs, self.noise)
            if self._accepts(evidence - self.evidence + prior):
                self.blobs, self.evidence = blobs, evidence
            return
        rows = self._response_of(blob)
        gram, linear = self._with(k, rows)
        evidence = self._evidence(gram, linear, blobs, self.noise)
        if self._accepts(evidence - self.evidence + prior):
            self._take(k, rows, gram, linear, blobs, evidence)

    def _born(self, place: Floats | None = None, odds: float = 0.0) -> bool:
        """Propose one more blob, anywhere or near ``place``; ``odds`` is the log prior ratio of what else changes."""
        if len(self.blobs) >= MOST:
            return False
        rng = self.rng
        x, y = self.places.drawn(rng) if place is None else place + NEAR * self.places.pitch * rng.standard_normal(2)
        size = self.middle + SIZE * rng.standard_normal()
        density = self.places.at(x, y)[0]
        if not self.least <= size <= self.largest or not density > 0:
            return False
        scale = self.level + math.log(4 * math.pi) + 2 * size + TRACTION * rng.standard_normal()
        blob = np.array([x, y, size, scale])
        rows = self._response_of(blob)
        gram, linear = self._with(len(self.blobs), rows)
        blobs = np.vstack([self.blobs, blob])
        evidence = self._evidence(gram, linear, blobs, self.noise)
        accepted = self._accepts(evidence - self.evidence + odds + self._added(blobs, -1, place))
        if accepted:
            self._take(len(self.blobs), rows, gram, linear, blobs, evidence)
        return accepted

    def _dies(self, place: Floats | None = None, odds: float = 0.0) -> bool:
        """Propose to remove one blob, any or one near ``place``."""
        chances = self._near(self.blobs, place)
        total = float(chances.sum())
        if not total > 0:
            return False
        k = int(self.rng.integers(len(chances)) if place is None else self.rng.choice(len(chances), p=chances / total))
        stay, blobs, evidence = self._without(k)
        accepted = self._accepts(evidence - self.evidence + odds - self._added(self.blobs, k, place))
        if accepted:
            self._leave(stay, blobs, evidence)
        return accepted

    def _near(self, blobs: Floats, place: Floats | None) -> Floats:
        """Return the relative probability of each blob to be removed: the density [1/m^2] of births near ``place``, or 1."""
        if place is None:
            return np.ones(len(blobs))
        variance = (NEAR * self.places.pitch) ** 2
        squares = ((blobs[:, :2] - place) ** 2).sum(axis=1)
        return np.asarray(np.exp(-0.5 * squares / variance) / (2 * math.pi * variance))

    def _added(self, blobs: Floats, k: int, place: Floats | None) -> float:
        """Return the log of prior over proposal of blob ``k``, times the probability that it is the one to be removed."""
        density, proposed = self.places.at(*blobs[k, :2])
        # near a place, the density of the proposal and of the choice cancel
        each = proposed * len(blobs) if place is None else float(self._near(blobs, place).sum())
        return math.log(COUNT * density / each)

    def _hyper(self) -> None:
        """Sample the typical traction, and the noise if it is unknown."""
        rng, count = self.rng, len(self.blobs)
        if count:
            each = self.level + self._traction(self.blobs[:, 3], self.blobs[:, 2])
            self.level = float(each.mean() + TRACTION / math.sqrt(count) * rng.standard_normal())
        if not self.known:
            noise = self.noise * math.exp(NOISE_STEP * rng.standard_normal())
            if noise < self.least_noise:
                return
            evidence = self._evidence(self.gram, self.linear, self.blobs, noise)
            if self._accepts(evidence - self.evidence):
                self.noise, self.evidence = noise, evidence

    def _doubts(self) -> None:
        """Propose to switch a doubtful vector between an outlier, with an offset of its own, and a normal vector. Half of
        the proposals replace the offset with a blob near the vector, because neither alone would explain it.
        """
        k, without_blob = int(self.rng.integers(len(self.wrong))), self.rng.random() < 0.5
        outlier = not self.wrong[k]
        self._switch(k, outlier)
        odds = self.odds if outlier else -self.odds
        place = self.vectors.places[self.vectors.doubtful[k]]
        if without_blob:
            evidence = self._evidence(self.gram, self.linear, self.blobs, self.noise)
            accepted = self._accepts(evidence - self.evidence + odds)
            if accepted:
                self.evidence = evidence
        else:
            accepted = self._dies(place, odds) if outlier else self._born(place, odds)
        if not accepted:
            self._switch(k, not outlier)

    def _switch(self, k: int, wrong: bool) -> None:
        """Let a doubtful vector have an offset, or none."""
        self.wrong[k] = wrong
        self.scales[3 + 2 * k : 5 + 2 * k] = self.offset if wrong else 0.0

    def walk(self, steps: int, *, count: bool = True) -> None:
        """Do ``steps`` steps. With ``count=False`` the number of blobs does not change."""
        rng, pitch = self.rng, self.places.pitch
        for step in range(steps):
            kind = rng.random()
            if count and (kind < BIRTH or not len(self.blobs)):
                self._born()
            elif count and kind < BIRTH + DEATH:
                self._dies()
            elif len(self.blobs):
                k = int(rng.integers(len(self.blobs)))
                blob = self.blobs[k].copy()
                kind = kind - BIRTH - DEATH if count else kind * (1.0 - BIRTH - DEATH)
                if kind < MOVE:
                    reach = 0.3 * math.hypot(
                        math.exp(blob[2]), 0.3 * pitch
                    )  # a fraction of the size of the blob, which this step does not change
                    blob[:2] += reach * math.exp(rng.uniform(-2.0, 0.5)) * rng.standard_normal(2)
                elif kind < MOVE + RESIZE:
                    blob[2] += SIZE_STEP * math.exp(rng.uniform(-1.5, 0.5)) * rng.standard_normal()
                elif kind < MOVE + RESIZE + RESCALE:
                    blob[3] += SCALE_STEP * rng.standard_normal()
                else:
                    blob[:2] += pitch * rng.standard_normal(2)
                    blob[2] += 0.3 * rng.standard_normal()
                self._changed(k, blob)
            if step % EVERY == 0:
                self._hyper()
            if len(self.wrong) and step % DOUBT == 0:
                self._doubts()

    # -- start

    def put(self, blob: Floats) -> None:
        """Add a blob if it raises the evidence."""
        if len(self.blobs) >= MOST or not math.isfinite(self._prior(blob)):
            return
        rows = self._response_of(blob)
        gram, linear = self._with(len(self.blobs), rows)
        blobs = np.vstack([self.blobs, blob])
        evidence = self._evidence(gram, linear, blobs, self.noise)
        if evidence > self.evidence + WORTH:
            self._take(len(self.blobs), rows, gram, linear, blobs, evidence)

    def prune(self) -> None:
        """Remove blobs that do not raise the evidence."""
        for k in reversed(range(len(self.blobs))):
            stay, blobs, evidence = self._without(k)
            if evidence > self.evidence - WORTH:
                self._leave(stay, blobs, evidence)

    def forces(self) -> tuple[Floats, Floats]:
        """Posterior mean of drift and forces (drift and blob * 2,), and the forces (blob, 2) [N] of one draw."""
        factor = self._factor(self.gram, self.linear, self.blobs, self.noise)
        if factor is None:
            raise RuntimeError("an accepted state has a factor")
        lower, right, scale = factor
        used = self._used(self.count)

        def back(values: Floats) -> Floats:
            out = np.zeros(self.count)
            out[used] = scale * scipy.linalg.solve_triangular(lower, values, lower=True, trans=1)
            return out

        mean = back(right) / self.noise**2
        draw = mean + back(self.rng.standard_normal(len(right)))
        return mean, draw[self.fixed :].reshape(-1, 2)

    def modelled(self, vectors: Vectors, mean: Floats) -> Floats:
        """Return the displacement (2, n) [m] that the mean drift and forces cause at other vectors."""
        drift = vectors.drift(vectors.places)
        middle = vectors.middle - self.vectors.middle
        # the other vectors rotate about another middle
        drift[2] += -middle[1] * drift[0] + middle[0] * drift[1]
        out = (mean[:3] * self.vectors.units) @ drift
        for blob, force in zip(self.blobs, mean[self.fixed :].reshape(-1, 2)):
            out = out + force @ vectors.rows(self.response, float(blob[0]), float(blob[1]), math.exp(blob[2]))
        return np.asarray(out.reshape(2, -1))
