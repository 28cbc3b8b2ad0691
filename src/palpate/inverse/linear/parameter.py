"""How much to regularise: rules in closed form over the spectrum of the problem.

The readings are expanded in the singular vectors of the whitened operator: coefficients c_i, singular values s_i,
filter factors phi_i(lambda). Every rule is a sum over i, evaluated for all frames and parameters at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
import numpy.typing as npt

from palpate.elastic.pad import Floats
from palpate.errors import InvalidInput, Unsupported

__all__ = [
    "RULES",
    "Filter",
    "by_discrepancy",
    "candidates",
    "check_parameter",
    "choose_parameter",
    "refined",
    "tikhonov",
    "truncate",
]

Rule = Literal["evidence", "gcv", "lcurve", "discrepancy"]
RULES: tuple[str, ...] = ("evidence", "gcv", "lcurve", "discrepancy")
Filter = Callable[[Floats, Floats], Floats]

#: Candidates span this many decades below the largest eigenvalue (all that double precision tells from zero) and two above, at this many
#: to a decade; the minimum is then refined by a parabola, so that a step of a fifth costs nothing.
DECADES, PER_DECADE = 16, 12
#: Cut-offs lie between eigenvalues above this part of the largest, a few roundings of it: what is below is not told from zero.
SMALLEST = 1e-15
#: Most cut-offs that are tried: where there are more readings, neighbours keep counts that differ by a six-hundredth.
CUT_OFFS = 600
#: Parameters that leave fewer degrees of freedom than this part of the readings are out: the sum is known to 1e-16 of the count, so that
#: the score is still right to a millionth.
FREE = 1e-9
#: The L-curve is looked at above this part of the largest eigenvalue: an eigenvalue of n readings is known to n roundings, some 1e-14.
CORNER = 1e-14
#: Where neither logarithm moves by this much from one candidate to the next, no corner is sought: their rounding, 1e-14, makes a curvature of
#: 1e-14/FLAT^2 = 0.01 there, and a corner's is of order one.
FLAT = 1e-6
#: Keeps logarithms of what rounds to nothing finite; near the smallest double.
TINY = 1e-300


def check_parameter(parameter: float | str) -> None:
    """Raise unless it is a positive number or the name of a rule."""
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


def choose_parameter(
    rule: str,
    filter_factors: Filter,
    eigenvalues: Floats,
    multiplicity: Floats,
    power: Floats,
    *,
    noise_known: bool,
) -> tuple[Floats, Floats]:
    """The regularisation parameter of each frame by a rule.

    Parameters
    ----------
    rule : str
        "gcv": generalised cross-validation, min m sum r^2/(sum (1 - phi))^2 (Golub, Heath, Wahba 1979).
        "lcurve": the corner (largest curvature) of log residual against log penalty (Hansen 1992).
        "discrepancy": residual equal to the noise, sum r^2 = m; needs the noise (Morozov 1966).
        "evidence": largest marginal likelihood of a Gaussian prior of unknown scale and, where the noise is not
        known, noise of unknown size (MacKay 1992). For Tikhonov filters only.
    eigenvalues : array (n,)
        s^2 of the noise-whitened operator.
    multiplicity : array (n,)
        How many real data each coefficient stands for.
    power : array (frame, n)
        |c|^2 per datum.
    noise_known : bool
        Whether whitening used the true noise, so that residuals have unit variance.

    Returns
    -------
    parameter, noise_variance : arrays (frame,)
        The noise variance is relative to the whitening (1 where it is known).
    """
    check_parameter(rule)
    if rule == "discrepancy" and not noise_known:
        raise Unsupported(
            'the discrepancy principle needs the noise: give the array noise=..., or use parameter="evidence" or "gcv".'
        )
    if rule == "evidence" and filter_factors is not tikhonov:
        raise Unsupported('parameter="evidence" is not defined for truncation; use "gcv", "lcurve" or "discrepancy".')
    top = float(eigenvalues.max())
    grid: Floats
    score: Floats
    if filter_factors is truncate:
        levels = np.unique(eigenvalues[eigenvalues > SMALLEST * top])
        # half-way between neighbours, so that rounding cannot move a value across; at least one is kept
        grid = np.concatenate([[0.5 * levels[0]], np.sqrt(levels[:-1] * levels[1:])])
        if len(grid) > CUT_OFFS:
            grid = grid[np.unique(np.linspace(0, len(grid) - 1, CUT_OFFS).astype(int))]
    else:
        grid = candidates(eigenvalues)
    datum = multiplicity * power  # (frame, n)
    count = float(multiplicity.sum())
    phi = filter_factors(eigenvalues[None, :], grid[:, None])  # (candidate, n)
    residual = datum @ ((1.0 - phi) ** 2).T  # (frame, candidate)

    if rule == "gcv":
        free = (1.0 - phi) @ multiplicity
        free[free < FREE * count] = np.nan
        score = count * residual / free**2
    elif rule == "discrepancy":
        score = np.abs(np.log(np.maximum(residual, TINY) / count))
    elif rule == "lcurve":
        safe = np.where(eigenvalues > 0, eigenvalues, 1.0)
        penalty = datum @ np.where(eigenvalues > 0, phi**2 / safe, 0.0).T
        score = -_curvature(np.log(np.maximum(residual, TINY)), np.log(np.maximum(penalty, TINY)))
        # beyond the spectrum's ends every lambda does the same, and rounding makes corners of its own
        positive = eigenvalues[eigenvalues > CORNER * top]
        score[:, (grid < positive.min()) | (grid > top)] = np.inf
    else:
        explained = datum @ (1.0 - phi).T  # sum c^2/(1 + s^2/lambda)
        logdet = -np.log(np.maximum(1.0 - phi, TINY)) @ multiplicity
        if noise_known:
            score = explained + logdet
        else:
            score = count * np.log(np.maximum(explained / count, TINY)) + logdet
    score = np.where(np.isfinite(score), score, np.inf)
    best = np.argmin(score, axis=1)
    parameter = grid[best].copy()
    if filter_factors is tikhonov:
        parameter = refined(grid, score, best)
    if noise_known:
        return parameter, np.ones(len(parameter))
    phi = filter_factors(eigenvalues[None, :], parameter[:, None])
    if filter_factors is tikhonov:
        variance = (datum * (1.0 - phi)).sum(axis=1) / count
    else:
        variance = (datum * (1.0 - phi) ** 2).sum(axis=1) / np.maximum((1.0 - phi) @ multiplicity, 1.0)
    return parameter, variance


#: Misfit is brought this near to the noise (relative): the noise of 5000 readings is known no better (1/sqrt(2 n)).
DISCREPANCY = 0.01
#: Where it is sought, as parts of a unit in which a parameter of 1 leaves nothing of the traction (10 more than all, to be sure that both
#: sides of the noise are there), and how often that is halved: 23 in the logarithm comes to 0.6 % of the parameter.
SOUGHT, BISECTIONS = (1e-9, 10.0), 12


def by_discrepancy(misfit: Callable[[float], float], noise: float, unit: float) -> float:
    """The parameter whose root mean square ``misfit`` is the noise, by bisection of its logarithm between 1e-9 and 10 ``unit`` (`SOUGHT`).

    For methods that have no spectrum; ``misfit`` is asked once for each parameter tried, the one returned last.
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


def _curvature(a: Floats, b: Floats) -> Floats:
    """Curvature of the curves (a, b) along axis 1; the flat ends are left out."""
    da, db = np.gradient(a, axis=1), np.gradient(b, axis=1)
    dda, ddb = np.gradient(da, axis=1), np.gradient(db, axis=1)
    speed = (da**2 + db**2) ** 1.5
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = (da * ddb - db * dda) / speed
    moving = (np.abs(da) > FLAT) | (np.abs(db) > FLAT)
    # candidates run from strong to weak regularisation, so a falls, b rises, and the corner turns to the right
    return np.where(moving, -curvature, -np.inf)


def candidates(eigenvalues: Floats) -> Floats:
    """Parameters that are tried, from strong to weak."""
    return np.asarray(float(eigenvalues.max()) * 10.0 ** np.linspace(2.0, -DECADES, (DECADES + 2) * PER_DECADE + 1))


def refined(grid: Floats, score: Floats, best: npt.NDArray[np.intp]) -> Floats:
    """Vertex of the parabola through the best candidate and its neighbours, in log lambda."""
    inner = np.clip(best, 1, len(grid) - 2)
    rows = np.arange(len(best))
    low, mid, high = (score[rows, inner + d] for d in (-1, 0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = 0.5 * (low - high) / (low - 2 * mid + high)
    shift = np.where((inner == best) & np.isfinite(shift), np.clip(shift, -0.5, 0.5), 0.0)
    step = np.log(grid[1] / grid[0])
    return np.asarray(grid[best] * np.exp(step * shift))
