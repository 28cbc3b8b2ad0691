"""Variances of a contact model on the face of the constraints that its solution lies on, and the degrees of freedom
that it uses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Solution
from palpate.inverse.constrained.faces import Face
from palpate.inverse.constrained.factors import Bordered, Dense, Factor, FewReadings
from palpate.inverse.constrained.iterative import Iterative
from palpate.inverse.constrained.model import ContactModel
from palpate.inverse.constrained.quadratic import Formed
from palpate.inverse.constrained.rows import Rows

__all__ = [
    "UNTOLD",
    "carried",
    "covariance_of",
    "deviations_of",
    "face_of",
    "log_determinant",
    "seen_of",
    "shared_errors",
    "taken_by",
    "taken_of_each",
    "told_by_each",
    "told_of",
    "unit_of",
    "variance_of",
    "variance_of_sums",
    "with_matrix",
]


#: Unknowns beside contact are undetermined below this fraction of the largest information on any.
UNTOLD = 1e-6
#: Unknowns up to which a hundred solutions take less time from a matrix than by products: on 16 x 16 x 3 with 1863
#: unknowns 0.3 s instead of 1.3. For up to `FEW_SOLUTIONS`, products take less.
FEW_UNKNOWNS, FEW_SOLUTIONS = 2000, 20


def with_matrix(model: ContactModel, solutions: int) -> ContactModel:
    """The model with an explicit matrix and an exact factor, if it was solved by products, has few unknowns, and is
    used for many ``solutions``: then they take less time.
    """
    face, factor = face_of(model.solution)
    few = solutions <= FEW_SOLUTIONS or model.solution.traction.size > FEW_UNKNOWNS
    if not isinstance(factor, Iterative) or few:
        return model
    data = model.data.as_matrix()
    hessian = data.quadratic(model.penalty)
    if (face.scales != 1.0).any():
        hessian = hessian.scaled(face.scales)
    exact = replace(model.solution, factor=hessian.factor(face, factor.more))
    return replace(model, data=data, hessian=hessian, solution=exact)


def carried(solution: Solution, rows: Floats) -> Floats:
    """H^-1 rows' (free, row) for ``rows`` (row, component * cell), on the face of the cone that the solution lies on."""
    face, factor = face_of(solution)
    return factor.inverse(face.columns(rows).T)


def covariance_of(solution: Solution, rows: Floats) -> Floats:
    """Posterior covariance (row, row) of rows' x on that face."""
    face, factor = face_of(solution)
    local = face.columns(rows)
    found = local @ factor.inverse(local.T)
    return np.asarray(0.5 * (found + found.T))


def told_by_each(model: ContactModel, rows: Floats, white: Floats) -> Floats:
    """Contribution of each reading to sums ``rows`` (row, component * cell) of a contact, (reading, row): dF/dy y,
    with dF/dy = A H^-1 rows' on the face of the contact. ``white`` are the whitened readings.
    """
    told = seen_of(model, carried(model.solution, rows))
    return np.asarray(told * white[:, None])


def told_of(model: ContactModel, rows: Floats) -> Floats:
    """Schur complement S = B'B - B'A H^-1 A'B: information on unknowns with whitened columns ``rows`` B (reading,
    unknown), beside the contact on its face.
    """
    return np.asarray(rows.T @ rows - covariance_of(model.solution, rows.T @ model.data.matrix))


def unit_of(rows: Floats) -> Floats:
    """Length of each column of ``rows`` (reading, unknown). Divide the columns by it before `UNTOLD` compares unknowns:
    the information on an offset in Pa and on a ramp in Pa/m differs by the square of the array's length [m^2].
    """
    return np.maximum(np.sqrt((rows**2).sum(axis=0)), 1e-300)


def deviations_of(precision: Floats) -> Floats:
    """Square roots of the diagonal of S^-1. Undetermined directions get `UNTOLD` of the largest information."""
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
    values = np.maximum(values, UNTOLD * max(float(values.max(initial=0.0)), 1e-300))
    return np.asarray(np.sqrt((vectors**2 / values).sum(axis=1)))


def seen_of(model: ContactModel, moved: Floats) -> Floats:
    """Change of the whitened readings (reading, k) caused by steps (free, k) in the free directions."""
    face = face_of(model.solution)[0]
    return np.asarray(model.data.matrix @ np.asarray(face.directions().T @ moved))


def by_gains(model: ContactModel, rows: Floats, white: Floats) -> Floats:
    """Variances of sums ``rows`` of a contact if each reading has an independent gain error with standard deviation 1
    (100 %): sum over readings of (dF/dy y)^2, as in `told_by_each`.
    """
    return np.asarray((told_by_each(model, rows, white) ** 2).sum(axis=0))


def face_of(solution: Solution) -> tuple[Face, Factor]:
    """The face of the cone that a solution lies on, and the factor of the normal matrix there."""
    if solution.face is None or solution.factor is None:
        raise RuntimeError("the solution was found without its face")
    return solution.face, solution.factor


def taken_by(model: ContactModel) -> float:
    """Degrees of freedom that a model uses of the readings; cached for each factor."""
    face, factor = face_of(model.solution)
    if model.taken is None or model.taken[0] is not factor:
        # The inverse takes 2/3 n^3 and serves the variances too; columns of all readings take n^2 each.
        if isinstance(factor, Dense) and 3 * model.data.readings > 2 * len(factor.lower):
            found = factor.trace(face.restrict(Formed(model.data.gram).scaled(face.scales).matrix))
        else:
            found = float(taken_of_each(model).sum())
        model.taken = factor, found
    return model.taken[1]


def taken_of_each(model: ContactModel) -> Floats:
    """Degrees of freedom that a model uses of each reading."""
    factor = face_of(model.solution)[1]
    if isinstance(factor, FewReadings | Iterative):
        return factor.taken()
    if isinstance(factor, Bordered) and isinstance(factor.inner, Iterative):
        taken = factor.inner.taken()
        return taken + len(factor.corner) / max(len(taken), 1)
    return factor.squares(face_of(model.solution)[0].columns(model.data.matrix))


def log_determinant(model: ContactModel) -> float:
    """Log determinant of 1 + G P^-1 G', the covariance of the whitened readings under the penalty P as a prior, on the
    free directions of the solution.
    """
    face, factor = face_of(model.solution)
    if isinstance(factor, FewReadings):
        return 2.0 * float(np.log(np.diagonal(factor.lower)).sum())
    if not isinstance(factor, Dense):
        raise TypeError("there is no determinant without a factor")
    hessian = model.hessian.scaled(face.scales) if (face.scales != 1.0).any() else model.hessian
    reduced = np.diagonal(face.restrict(hessian.dense()))
    # At the limit of friction the factor has that limit's curvature, which counts with P.
    bent = np.maximum((factor.lower**2).sum(axis=1) - reduced, 0.0) if face.mixed else np.zeros(len(reduced))
    parts, _ = model.penalty.scaled(face.scales).parts(face, bent)
    return 2.0 * float(np.log(np.diagonal(factor.lower)).sum()) - sum(p.log_determinant for p in parts)


def shared_errors(model: ContactModel, columns: Floats, prior: Floats) -> Floats:
    """K (free, unknown): error of a model due to unknowns that act on many readings at once; K K' is added to its
    covariance.

    ``columns`` (reading, unknown) is the whitened effect of each unknown on the readings; ``prior`` (unknown,) its
    standard deviation. With X = H^-1 W'A' B on the face, a change c of the unknowns changes the traction by -X c. An
    unknown with infinite deviation is determined by the readings: (B'B - B'A W X)^-1. A finite deviation is not
    reduced: the penalty's amplitude was learned from these readings and adds no information.
    """
    rows = columns.T @ model.data.matrix
    x = carried(model.solution, rows)
    observed = np.isinf(prior)
    out = x * np.where(observed, 0.0, prior)
    if observed.any():
        b, found = columns[:, observed], x[:, observed]
        precision = b.T @ b - face_of(model.solution)[0].columns(rows[observed]) @ found
        values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
        # Directions that the readings do not determine keep the largest uncertainty.
        floor = 1e-6 * max(float(np.trace(b.T @ b)), 1e-300)
        out[:, observed] = found @ (vectors / np.sqrt(np.maximum(values, floor)))
    return np.asarray(out)


def variance_of(model: ContactModel, rows: Rows, *, few: bool = False) -> Floats:
    """Posterior variance of sparse rows' x over (component, cell), with correlations; ``few``: use few samples if it
    is computed from samples.
    """
    face, factor = face_of(model.solution)
    local = face.rows(rows)
    out = factor.variances(local, few=few) if isinstance(factor, Iterative) else factor.variances(local)
    if model.shared is not None:
        out = out + (local.times(model.shared) ** 2).sum(axis=1)
    return np.asarray(out)


def stated_variance_of(model: ContactModel, rows: Rows) -> Floats:
    """Variance of sparse rows' x over (component, cell) due to the uncertainty of the pad (`ContactModel.stated`)."""
    if model.stated is None:
        return np.zeros(rows.count)
    return np.asarray((face_of(model.solution)[0].rows(rows).times(model.stated) ** 2).sum(axis=1))


def stated_variance_of_sums(model: ContactModel, rows: Floats) -> Floats:
    """Return, for dense rows, the variance due to the unknowns of ``model.stated``; 0 without any."""
    if model.stated is None:
        return np.zeros(len(rows))
    return np.asarray(((face_of(model.solution)[0].columns(rows) @ model.stated) ** 2).sum(axis=1))


def variance_of_sums(model: ContactModel, rows: Floats) -> Floats:
    """Posterior variance for dense rows."""
    face, factor = face_of(model.solution)
    local = face.columns(rows)
    out = factor.squares(local)
    if model.shared is not None:
        out = out + ((local @ model.shared) ** 2).sum(axis=1)
    return np.asarray(out)
