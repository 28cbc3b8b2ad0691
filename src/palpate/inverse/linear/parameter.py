"""Rules that choose the regularisation parameter, in closed form over the spectrum of the problem.

The readings are expanded in the singular vectors of the whitened operator: coefficients c_i, singular values s_i,
filter factors phi_i(lambda). Every rule is a sum over i, evaluated for all frames and parameters at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from palpate._threads import cached_property
from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported
from palpate.inverse.linear.lumps import cubic_weights

__all__ = [
    "MODEL_ERROR",
    "RULES",
    "Choice",
    "Curves",
    "Filter",
    "SpectrumCurves",
    "Tried",
    "amplitude",
    "by_discrepancy",
    "candidates",
    "check_parameter",
    "check_rule",
    "choose",
    "choose_parameter",
    "filtered_inverse",
    "mean_sizes",
    "minus_evidence",
    "noise_variance",
    "pick",
    "refined",
    "tikhonov",
    "tried_on",
    "truncate",
]

#: Names of the rules that choose a regularisation parameter.
RULES: tuple[str, ...] = ("evidence", "gcv", "lcurve", "discrepancy")
Filter = Callable[[Floats, Floats], Floats]

#: Candidates span DECADES below the largest eigenvalue (the range of double precision) and two above, PER_DECADE each.
#: A parabola refines the minimum, so that this step is fine enough.
DECADES, PER_DECADE = 16, 12
#: Cut-offs lie between eigenvalues above this fraction of the largest, a few rounding errors; smaller eigenvalues count
#: as zero.
SMALLEST = 1e-15
#: Eigenvalues that differ by less than this relative amount count as equal: for a few thousand readings they are
#: accurate to about 1e-12.
PAIR = 1e-9
#: Largest number of cut-offs to try; with more readings, neighbouring counts differ by a six-hundredth.
CUT_OFFS = 600
#: Reject parameters whose residual has fewer degrees of freedom than this fraction of the readings: the sum is accurate
#: to 1e-16 of the count, so that the score is still accurate to a millionth.
FREE = 1e-9
#: The L-curve is evaluated above this fraction of the largest eigenvalue: an eigenvalue of n readings is accurate to n
#: rounding errors, about 1e-14.
CORNER = 1e-14
#: Where neither logarithm changes by this much between candidates, do not look for a corner: rounding of 1e-14 causes a
#: curvature of 1e-14/FLAT^2 = 0.01 there, compared with about one at a corner.
FLAT = 1e-6
#: Smallest angle [rad] by which an L-curve must turn at a corner, a fifth of an L's. Corners that regularise well turn
#: by 0.37 to 0.95; curves that bend the other way except for a ripple, by 0 to 0.26 (stresses under a ball,
#: displacements of real gels).
TURN = 0.1 * math.pi
#: Keeps logarithms of rounded values finite; near the smallest double.
TINY = 1e-300
#: Longer spectra are binned, with this many bins per decade of s^2, down to this many decades below the smallest
#: candidate.
LONG, BINS_PER_DECADE, BELOW = 4096, 24, 6
#: Steps per candidate when averaging over candidates.
FINER = 8

#: Smallest noise to assume, as a fraction of the largest reading: no pad and no grid is more accurate. A convention,
#: which only matters for lower noise.
MODEL_ERROR = 2e-4


@dataclass(frozen=True)
class Choice:
    """The choice for each frame (frame,): parameter, noise variance relative to the whitening, sum of squares of the
    residual and its degrees of freedom, whether the rule fell back to another one, and that rule's name.
    """

    parameter: Floats
    noise_variance: Floats
    residual: Floats
    free: Floats
    fell_back: npt.NDArray[np.bool_]
    fallback: str


def check_parameter(parameter: float | str) -> None:
    """Raise an error unless it is a positive number or the name of a rule."""
    if isinstance(parameter, str):
        good = parameter in RULES
    else:
        good = not isinstance(parameter, bool) and 0 < float(parameter) < math.inf
    if not good:
        raise InvalidInput(f"parameter must be a positive number or one of {', '.join(RULES)}; got {parameter!r}.")


def tikhonov(eigenvalues: Floats, parameter: Floats) -> Floats:
    """phi = s^2/(s^2 + lambda)."""
    return eigenvalues / (eigenvalues + parameter)


def truncate(eigenvalues: Floats, parameter: Floats) -> Floats:
    """phi = 1 where s^2 > lambda."""
    return np.where(eigenvalues > parameter, 1.0, 0.0)


def filtered_inverse(filter_factors: Filter, eigenvalues: Floats, parameter: Floats) -> Floats:
    """phi/s (frame, n), by which coefficients are multiplied; 0 where s is 0."""
    seen = eigenvalues > 0
    phi = filter_factors(eigenvalues, parameter[:, None])
    return np.where(seen, phi / np.sqrt(np.where(seen, eigenvalues, 1.0)), 0.0)


def choose_parameter(
    rule: str,
    filter_factors: Filter,
    eigenvalues: Floats,
    multiplicity: Floats,
    power: Floats,
    *,
    noise_known: bool,
    tried: Tried | None = None,
) -> tuple[Floats, Floats]:
    """Parameter and noise variance of each frame by a rule; see `choose`."""
    found = choose(rule, filter_factors, eigenvalues, multiplicity, power, noise_known=noise_known, tried=tried)
    return found.parameter, found.noise_variance


def choose(
    rule: str | float,
    filter_factors: Filter,
    eigenvalues: Floats,
    multiplicity: Floats,
    power: Floats,
    *,
    noise_known: bool,
    floor: Floats | None = None,
    tried: Tried | None = None,
) -> Choice:
    """The regularisation parameter of each frame by a rule, and the noise for it.

    Parameters
    ----------
    rule : str or float
        The parameter itself, or a rule. "gcv": generalised cross-validation, min m sum r^2/(sum (1 - phi))^2 (Golub, Heath, Wahba 1979).
        "lcurve": the corner (largest curvature) of log residual against log penalty (Hansen 1992). Frames whose curve has none (a traction rough at
        every wavelength) use "evidence" ("gcv" for truncated spectra).
        "discrepancy": residual equal to the noise, sum r^2 = m; needs the noise (Morozov 1966).
        "evidence": largest marginal likelihood of a Gaussian prior of unknown scale and, where the noise is not
        known, noise of unknown size (MacKay 1992). For Tikhonov filters only.
    eigenvalues : array (n,)
        s^2 of the noise-whitened operator.
    multiplicity : array (n,)
        Count of real data for each coefficient.
    power : array (frame, n)
        |c|^2 per datum.
    noise_known : bool
        Whether whitening used the true noise, so that residuals have unit variance.
    floor : array (frame,), optional
        Lower bound of an estimated noise variance.
    tried : Tried, optional
        The part that does not depend on the frames, if cached.

    Returns
    -------
    Choice
        The noise variance is relative to the whitening (1 if it is known).
    """
    least = None if noise_known else np.zeros(len(power)) if floor is None else floor
    datum = multiplicity * power  # (frame, n)
    instead = "gcv" if filter_factors is truncate else "evidence"
    without, by_evidence = np.zeros((2, len(power)), dtype=bool)
    if isinstance(rule, str):
        check_rule(rule, filter_factors, noise_known=noise_known)
        known = tried or tried_on(eigenvalues, multiplicity, filter_factors)

        def picked(rule: str, some: Any) -> tuple[Floats, npt.NDArray[np.bool_]]:
            found = pick(rule, SpectrumCurves(known, datum[some]), None if least is None else least[some])
            return found.parameter if filter_factors is tikhonov else known.grid[found.best], found.without

        parameter, without = picked(rule, slice(None))
        if without.any():
            parameter[without] = picked(instead, without)[0]
        by_evidence = without & (instead == "evidence") | (rule == "evidence")
    else:
        parameter = np.full(len(power), float(rule))
    left = 1.0 - filter_factors(eigenvalues, parameter[:, None])
    residual, free = (datum * left**2).sum(axis=1), left @ multiplicity
    explained, count = (datum * left).sum(axis=1), float(multiplicity.sum())
    variance = noise_variance(explained, residual, free, count, by_evidence, least)
    return Choice(parameter, variance, residual, free, without, instead)


def noise_variance(
    explained: Floats,
    residual: Floats,
    free: Floats,
    count: float,
    by_evidence: npt.NDArray[np.bool_],
    floor: Floats | None,
) -> Floats:
    """Noise variance of each frame (frame,) from the sums in `Curves` at its parameter: 1 if the noise is known
    (``floor`` None), else at least ``floor``. ``by_evidence``: the parameter is that of the largest evidence.
    """
    if floor is None:
        return np.ones(len(residual))
    return np.maximum(np.where(by_evidence, explained / count, residual / np.maximum(free, 1.0)), floor)


def check_rule(rule: str, filter_factors: Filter, *, noise_known: bool) -> None:
    """Raise an error unless the rule exists and applies to this filter and noise."""
    check_parameter(rule)
    if rule == "discrepancy" and not noise_known:
        raise Unsupported(
            'the discrepancy principle needs the noise: give the array noise=..., or use parameter="evidence" or "gcv".'
        )
    if rule == "evidence" and filter_factors is not tikhonov:
        raise Unsupported('parameter="evidence" is not defined for truncation; use "gcv", "lcurve" or "discrepancy".')


class Curves(Protocol):
    """Inputs of every rule, at the parameters ``grid`` (candidate,) from strong to weak regularisation.

    ``residual`` sum r^2, ``penalty`` of the traction and ``explained`` sum c^2 (1 - phi), all (frame, candidate); ``free`` sum (1 - phi) and ``logdet``
    -sum log(1 - phi) (candidate,); ``inside`` marks the candidates within the range of the eigenvalues; ``count`` is the number of readings.
    """

    @property
    def grid(self) -> Floats: ...
    @property
    def residual(self) -> Floats: ...
    @property
    def penalty(self) -> Floats: ...
    @property
    def explained(self) -> Floats: ...
    @property
    def free(self) -> Floats: ...
    @property
    def logdet(self) -> Floats: ...
    @property
    def inside(self) -> npt.NDArray[np.bool_]: ...
    @property
    def count(self) -> float: ...


class Tried:
    """Quantities of a spectrum at the parameters ``grid`` that the rules need for any frame, computed at first use."""

    _weights: tuple[Floats, Floats] | None = None

    def __init__(self, filter_factors: Filter, grid: Floats, eigenvalues: Floats, multiplicity: Floats) -> None:
        self.grid, self.count = grid, float(multiplicity.sum())
        self.values, self.multiplicity, self._filter = eigenvalues, multiplicity, filter_factors
        self.left = 1.0 - filter_factors(eigenvalues, grid[:, None])  # (candidate, n)
        self.ends = _ends(eigenvalues)

    def shared(self, datum: Floats) -> Floats:
        """Squared coefficients (frame, n) assigned to the values over which the sums are taken."""
        return datum

    @property
    def filtered_inverse(self) -> Floats:
        """phi/s (candidate, n)."""
        return filtered_inverse(self._filter, self.values, self.grid)

    @cached_property
    def squares(self) -> Floats:
        """(1 - phi)^2 (candidate, n)."""
        return self.left**2

    @cached_property
    def free(self) -> Floats:
        return np.asarray(self.left @ self.multiplicity)

    @cached_property
    def logdet(self) -> Floats:
        return np.asarray(-np.log(np.maximum(self.left, TINY)) @ self.multiplicity)

    def weights(self, eigenvalues: Floats) -> tuple[Floats, Floats]:
        """1/C = parameter / (parameter + value) of every value (candidate, n), and the sums of their logarithms (candidate,)."""
        if self._weights is None:
            found = self.grid[:, None] / (self.grid[:, None] + eigenvalues[None, :])
            with np.errstate(divide="ignore"):
                self._weights = found, np.log(found).sum(axis=1)
        return self._weights


def tried_on(eigenvalues: Floats, multiplicity: Floats, filter_factors: Filter = tikhonov) -> Tried:
    """Quantities of a spectrum for choosing the parameter; for Tikhonov's filter, long spectra are binned."""
    grid = _levels(eigenvalues) if filter_factors is truncate else candidates(eigenvalues)
    if filter_factors is tikhonov and len(eigenvalues) >= LONG:
        return Binned(grid, eigenvalues, multiplicity)
    return Tried(filter_factors, grid, eigenvalues, multiplicity)


class Binned(Tried):
    """A long spectrum in bins of log s^2, by cubic interpolation: the curves are smooth in it, and sums are accurate to about 1e-6.

    Eigenvalues below the bins are filtered out for every candidate.
    """

    def __init__(self, grid: Floats, eigenvalues: Floats, multiplicity: Floats) -> None:
        import scipy.sparse

        top = float(eigenvalues.max())
        count = BINS_PER_DECADE * (DECADES + BELOW)
        log = BINS_PER_DECADE * (np.log10(np.maximum(eigenvalues, TINY)) - math.log10(top)) + count
        inside = np.flatnonzero(log >= 0)
        weights = cubic_weights(log[inside], inside, count + 1, len(log))
        self._shares = scipy.sparse.vstack(
            [weights, scipy.sparse.csr_array((log < 0)[None].astype(float))], format="csr"
        )
        bins = np.append(top * 10.0 ** ((np.arange(count + 1) - count) / BINS_PER_DECADE), 0.0)
        super().__init__(tikhonov, grid, bins, self._shares @ multiplicity)
        self.ends = _ends(eigenvalues)

    def shared(self, datum: Floats) -> Floats:
        return np.asarray((self._shares @ datum.T).T)


class SpectrumCurves:
    """`Curves` of frames with squared coefficients ``datum`` (frame, n) in a spectrum, each computed at first use."""

    def __init__(self, tried: Tried, datum: Floats) -> None:
        self.grid, self.count = tried.grid, tried.count
        self._tried, self._datum = tried, tried.shared(datum)

    @cached_property
    def residual(self) -> Floats:
        return np.asarray(self._datum @ self._tried.squares.T)

    @cached_property
    def penalty(self) -> Floats:
        return np.asarray(self._datum @ (self._tried.filtered_inverse**2).T)

    @cached_property
    def explained(self) -> Floats:
        return np.asarray(self._datum @ self._tried.left.T)

    @property
    def free(self) -> Floats:
        return self._tried.free

    @property
    def logdet(self) -> Floats:
        return self._tried.logdet

    @cached_property
    def inside(self) -> npt.NDArray[np.bool_]:
        # Beyond the ends of the spectrum every lambda gives the same result, and rounding creates false corners.
        least, top = self._tried.ends
        return np.asarray((self.grid >= least) & (self.grid <= top))


class Picked(NamedTuple):
    """For each frame (frame,): the parameter, the candidate next to it, and whether the rule has no information."""

    parameter: Floats
    best: npt.NDArray[np.intp]
    without: npt.NDArray[np.bool_]


def _ends(eigenvalues: Floats) -> tuple[float, float]:
    """The smallest eigenvalue at which a corner may lie, and the largest."""
    top = float(eigenvalues.max())
    return float(eigenvalues[eigenvalues > CORNER * top].min(initial=top)), top


def pick(
    rule: str,
    curves: Curves,
    floor: Floats | None,
    among: npt.NDArray[np.bool_] | None = None,
    noise: float = 1.0,
) -> Picked:
    """Apply the rule to the curves; ``floor`` and ``noise`` as in `minus_evidence`, ``among`` (frame, candidate) the
    allowed candidates.
    """
    count = curves.count
    score: Floats
    if rule == "gcv":
        free = np.where(curves.free < FREE * count, np.nan, curves.free)
        score = count * curves.residual / free**2
    elif rule == "discrepancy":
        score = np.abs(np.log(np.maximum(curves.residual, TINY) / count))
    elif rule == "lcurve":
        curvature, turned = _bend(np.log(np.maximum(curves.residual, TINY)), np.log(np.maximum(curves.penalty, TINY)))
        score = np.where(curves.inside, -curvature, np.inf)
    else:
        score = minus_evidence(curves, floor, noise)[0]
    score = np.where(np.isfinite(score), score, np.inf)
    if among is not None:
        score = np.where(among, score, np.inf)
    best = np.argmin(score, axis=1)
    without = np.zeros(len(score), dtype=bool)
    if rule == "lcurve":
        ends = np.flatnonzero(curves.inside)[[0, -1]]
        without = (turned[np.arange(len(score)), best] < TURN) | np.isin(best, ends)
    return Picked(refined(curves.grid, score, best), best, without)


def amplitude(
    eigenvalues: Floats, multiplicity: Floats, power: Floats, floor: Floats | None, tried: Tried | None = None
) -> tuple[Floats, Floats]:
    """Posterior means of the sizes of traction and noise: prior amplitude alpha = sigma^2/lambda and noise variance
    sigma^2 (frame,).

    Means over lambda, weighted by its marginal likelihood with equal prior weight per decade. If the readings show
    nothing, this gives the largest amplitude that would not be detected. ``floor`` (frame,) is the lower bound of the
    noise variance, or None if the noise is known; ``tried`` as in `choose`.
    """
    tried = tried_on(eigenvalues, multiplicity) if tried is None else tried
    return mean_sizes(SpectrumCurves(tried, multiplicity * power), floor)


def mean_sizes(curves: Curves, floor: Floats | None) -> tuple[Floats, Floats]:
    """`amplitude` from the curves over all candidates."""
    from scipy.interpolate import CubicSpline

    coarse = np.log(curves.grid)[::-1]
    fine = np.linspace(coarse[0], coarse[-1], FINER * (len(coarse) - 1) + 1)
    found = (values[:, ::-1] for values in minus_evidence(curves, floor))
    # Both are smooth in log lambda, but with many readings the likelihood is narrower than a step.
    score, variance = (CubicSpline(coarse, values, axis=1)(fine) for values in found)
    grid = np.exp(fine)
    weight = np.exp(-0.5 * (score - score.min(axis=1, keepdims=True)))
    weight /= weight.sum(axis=1, keepdims=True)
    return (weight * variance / grid).sum(axis=1), (weight * variance).sum(axis=1)


def candidates(eigenvalues: Floats) -> Floats:
    """Parameters to try, from strong to weak regularisation."""
    return np.asarray(float(eigenvalues.max()) * 10.0 ** np.linspace(2.0, -DECADES, (DECADES + 2) * PER_DECADE + 1))


def _levels(eigenvalues: Floats) -> Floats:
    """Truncation thresholds to try."""
    levels = np.unique(eigenvalues[eigenvalues > SMALLEST * eigenvalues.max()])
    # Half-way between neighbours, so that rounding cannot move a value across. Keep at least one, and never split a
    # pair that symmetry makes equal, because rounding would decide which one stays.
    apart = levels[1:] > (1.0 + PAIR) * levels[:-1]
    grid: Floats = np.concatenate([[0.5 * levels[0]], np.sqrt(levels[:-1] * levels[1:])[apart]])
    if len(grid) > CUT_OFFS:
        grid = grid[np.unique(np.linspace(0, len(grid) - 1, CUT_OFFS).astype(int))]
    return grid


def minus_evidence(curves: Curves, floor: Floats | None, noise: float = 1.0) -> tuple[Floats, Floats]:
    """-2 log marginal likelihood and the noise variance (frame, candidate) for Tikhonov's filter, relative to ``noise``
    squared; ``floor`` as in `amplitude`.
    """
    explained, logdet = curves.explained / noise**2, curves.logdet
    if floor is None:
        return explained + logdet, np.ones_like(explained)
    variance = np.maximum(np.maximum(explained / curves.count, floor[:, None]), TINY)
    return curves.count * np.log(variance) + explained / variance + logdet, variance


#: Relative tolerance for matching the misfit to the noise: the noise of 5000 readings is known no better (1/sqrt(2 n)).
DISCREPANCY = 0.01
#: Search range, in a unit in which a parameter of 1 shrinks the traction to zero (ten times more, to include both sides
#: of the noise), and number of bisections: 23 in the logarithm give 0.6 % of the parameter.
SOUGHT, BISECTIONS = (1e-9, 10.0), 12


def by_discrepancy(misfit: Callable[[float], float], noise: float, unit: float) -> float:
    """The parameter whose root mean square ``misfit`` equals the noise, by bisection of its logarithm between 1e-9 and
    10 ``unit`` (`SOUGHT`).

    For methods without a spectrum. ``misfit`` is called once for each parameter tried, last for the one returned.
    """
    low, high = (math.log(part * unit) for part in SOUGHT)
    middle = high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        left = misfit(math.exp(middle))
        if abs(left - noise) < DISCREPANCY * noise:
            break
        if left > noise:
            high = middle
        else:
            low = middle
    return math.exp(middle)


def _bend(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Curvature of the curves (a, b) along axis 1, positive at a corner, and the angle [rad] by which the bend around
    each point turns.

    -inf and an angle of 0 where both coordinates are constant.
    """
    da, db = np.gradient(a, axis=1), np.gradient(b, axis=1)
    dda, ddb = np.gradient(da, axis=1), np.gradient(db, axis=1)
    speed = (da**2 + db**2) ** 1.5
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = (da * ddb - db * dda) / speed
    moving = (np.abs(da) > FLAT) | (np.abs(db) > FLAT)
    # Candidates run from strong to weak regularisation, so a falls, b rises, and the corner turns to the right.
    curvature = np.where(moving, -curvature, -np.inf)
    bends = moving & (curvature > 0)
    turned = np.zeros(a.shape)
    turn = np.where(bends, curvature * np.sqrt(da**2 + db**2), 0.0)  # curvature times arc length
    for row, here, angles in zip(turned, bends, turn):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], here, [False]]).astype(int)))
        for start, stop in zip(edges[::2], edges[1::2]):
            row[start:stop] = angles[start:stop].sum()
    return curvature, turned


def refined(grid: Floats, score: Floats, best: npt.NDArray[np.intp]) -> Floats:
    """Vertex, in log lambda, of the parabola through the best candidate and its neighbours."""
    inner = np.clip(best, 1, len(grid) - 2)
    rows = np.arange(len(best))
    low, mid, high = (score[rows, inner + d] for d in (-1, 0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = 0.5 * (low - high) / (low - 2 * mid + high)
    shift = np.where((inner == best) & np.isfinite(shift), np.clip(shift, -0.5, 0.5), 0.0)
    step = np.log(grid[1] / grid[0])
    return np.asarray(grid[best] * np.exp(step * shift))
