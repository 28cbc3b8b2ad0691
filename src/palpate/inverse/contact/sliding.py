"""Contact that slides as a whole: shear proportional to pressure, weighted by evidence against independent shear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import scipy.sparse

from palpate.elastic.pad import Floats
from palpate.inverse.constrained.cone import Cone, minimise
from palpate.inverse.constrained.differences import Sparse
from palpate.inverse.constrained.faces import Face, Ray
from palpate.inverse.constrained.factors import Bordered, cholesky
from palpate.inverse.constrained.model import ContactModel, Normal
from palpate.inverse.constrained.products import Applied
from palpate.inverse.constrained.quadratic import Penalty, Unformed
from palpate.inverse.contact.policy import Policy
from palpate.inverse.contact.score import shares_by_evidence

__all__ = ["expanded", "in_blocks", "ways_of_sliding"]

Index = npt.NDArray[np.intp]


def log_evidence(data: Normal, penalty: Penalty) -> float:
    """Log marginal likelihood, relative to noise alone, of a Gaussian model with a penalty and no constraints."""
    import scipy.linalg

    hessian, linear = data.quadratic(penalty), data.linear.ravel()
    if isinstance(hessian, Unformed):
        free = Face(*Cone((), tension=True).directions(data.linear), mixed=False)
        return hessian.factor(free, np.zeros(linear.size)).log_evidence(linear)
    factor = cholesky(hessian.dense().copy())
    half = scipy.linalg.solve_triangular(factor, linear, lower=True, check_finite=False)
    n = data.linear.shape[1]
    alone = penalty.dense()
    prior = [alone[i : i + n, i : i + n].copy() for i in range(0, len(linear), n)]
    wide = sum(float(np.log(np.diagonal(cholesky(p))).sum()) for p in prior)
    return 0.5 * float(half @ half) - float(np.log(np.diagonal(factor)).sum()) + wide


def expanded(one: ContactModel, data: Normal, ray: Floats, changes: Floats) -> ContactModel:
    """Turn a model of pressure into one of traction, ``ray`` times the pressure, with the joint uncertainty of both."""
    part = data.part(np.searchsorted(data.cells, one.cells))
    part = part if one.data.at_size else part.as_matrix()
    pressure = one.solution.traction[0]
    face = one.solution.face
    if face is None or one.solution.factor is None:
        raise RuntimeError("the solution was found without its face")
    free = face.free[0]
    turned = (changes[:, :, None] * pressure).reshape(len(changes), len(ray) * len(pressure))
    pull = (part.matrix @ turned.T).T @ part.matrix
    border = np.einsum("c,kcn->kn", ray, pull.reshape(len(changes), len(ray), len(pressure)))[:, free]
    factor = Bordered.of(one.solution.factor, border.T, pull @ turned.T)
    solution = replace(one.solution, traction=ray[:, None] * pressure, face=Ray(ray, free, turned), factor=factor)
    return ContactModel(part, one.hessian, one.penalty, solution, ray=ray, changes=changes)


def in_blocks(
    data: Normal, first: Floats, precisions: Sequence[Sparse], policy: Policy
) -> tuple[Normal, Floats, list[Sparse]]:
    """Reduce a contact that is too large for a matrix to square blocks of cells: return its normal equations for the
    blocks, the mean of the initial traction ``first`` in each block, and the penalties ``precisions`` for the blocks.

    ``precisions`` penalise differences between neighbouring cells. An even gradient across blocks of b cells a side
    becomes steps between the blocks, whose penalty is b times as large; so the penalties are divided by b.
    """
    matrix = data.matrix
    if not isinstance(matrix, Applied):
        raise TypeError("a contact that has a matrix needs no blocks")
    shape, c = data.level.grid.shape, matrix.components
    places = np.unravel_index(data.cells, shape)
    side = 1
    while True:
        counts = tuple(-(-n // side) for n in shape)
        flat = np.ravel_multi_index(tuple(p // side for p in places), counts)
        blocks, inverse = np.unique(flat, return_inverse=True)
        if c * len(blocks) <= policy.prior.sliding_unknowns:
            break
        side += 1
    n, k = len(data.cells), len(blocks)
    sums = scipy.sparse.csr_array((np.ones(n), (inverse, np.arange(n))), shape=(k, n))
    gram = np.empty((c, k, c, k))
    for column in range(c):
        for start in range(0, k, policy.work.blocks):
            some = np.arange(start, min(start + policy.work.blocks, k))
            unit = np.zeros((len(some), c, n), dtype=np.float32)
            unit[:, column] = inverse[None, :] == some[:, None]
            seen = matrix.adjoint(matrix.forward(unit))
            gram[:, :, column, some] = np.stack([sums @ seen[:, i].T for i in range(c)])
    known = gram.reshape(c * k, c * k)
    # Single precision makes the matrix indefinite by up to this amount, which a weak penalty does not repair.
    known[np.diag_indices(c * k)] += np.finfo(np.float32).eps * float(np.abs(known).sum(axis=1).max())
    linear = (sums @ data.linear.T).T
    onto = scipy.sparse.csr_array((np.ones(n), (data.cells, inverse)), shape=(math.prod(shape), k))
    coarse = [scipy.sparse.csr_array(onto.T @ q @ onto) / side for q in precisions]
    means = (sums @ first[:, data.cells].T).T / sums.sum(axis=1)
    cells = np.arange(k)
    return Normal(data.level, cells, np.zeros((0, c * k)), linear, 0.5 * (known + known.T)), means, coarse


def ways_of_sliding(
    data: Normal, first: Floats, cone: Cone, precisions: Sequence[Sparse], policy: Policy
) -> list[tuple[Floats, Floats, float]]:
    """Ways in which the contact may slide as a whole: (shear over pressure (component,), its possible changes (change,
    component), probability).

    Either at the given friction in any direction, or at less (sliding friction is below static friction, and the given
    value may be inexact). The probabilities come from the marginal likelihood of Gaussian models without constraints,
    against independent shear. ``data`` is on surface cells, ``first`` an initial traction (component, cell) of the
    whole surface, ``precisions`` the even penalty of each component.
    """
    mu, cells = float(cone.friction or 0.0), data.cells
    shape = data.level.grid.shape if math.prod(data.level.grid.shape) == precisions[0].shape[0] else (len(cells),)
    pressing = Penalty(cells, precisions[-1:], shape)
    c = len(precisions)
    pressure = first[-1:, cells]
    for turn in range(policy.prior.jointly):
        # Alternate between the ratio of shear to pressure and the pressure that belongs to it.
        explained = data.explained(pressure[0])
        pull = data.linear[:-1] @ pressure[0] - explained[:-1, -1]
        found = np.linalg.lstsq(explained[:-1, :-1], pull, rcond=None)[0]
        size = float(np.linalg.norm(found))
        if not size > 0:
            return []
        if turn < policy.prior.jointly - 1:
            one = data.along(np.append(found * min(1.0, mu / size), 1.0))
            pressure = minimise(one.quadratic(pressing), one.linear, Cone(cone.components[-1:]), pressure).traction
    full = mu * found / size
    turns = np.array([[-full[1], full[0]]]) if c == 3 else np.zeros((0, 1))
    ways = [
        (full, turns, math.log(2.0 * math.pi) if c == 3 else math.log(2.0)),
        (found * min(1.0, mu / size), np.eye(c - 1), math.log(math.pi * mu**2 if c == 3 else 2.0 * mu)),
    ]
    logs = [log_evidence(data, Penalty(cells, precisions, shape))]
    for ratio, changes, volume in ways:
        one = data.along(np.append(ratio, 1.0))
        observed = changes @ explained[:-1, :-1] @ changes.T
        width = 0.5 * len(changes) * math.log(2.0 * math.pi) - 0.5 * float(np.linalg.slogdet(observed)[1])
        logs.append(log_evidence(one, pressing) + min(width, volume) - volume)
    chances = shares_by_evidence(logs)
    kept = [(w, float(p)) for w, p in zip(ways, chances[1:]) if p >= policy.prior.slides]
    return [(np.append(ratio, 1.0), np.pad(changes, ((0, 0), (0, 1))), p) for (ratio, changes, _), p in kept]
