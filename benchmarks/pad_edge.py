"""Readings of a pad that ends: the table behind the row "edge" of `palpate bench trust`, by finite elements.

    pip install scikit-fem && python benchmarks/pad_edge.py [--check]

A strip, 5 thicknesses wide and endless along y (Poisson's ratio 0.48), is glued to a rigid base; its sides are free. A ball presses or drags (Hertz's pressure,
shear of the same shape), its rim half to one thickness away from the side x = 2.5. Taxels at the base, 5 x 5 at 0.75 thicknesses, feel the stress (s_xz, s_yz, s_zz): what the base
pushes back with, from the nodal reactions. Along y everything is a Fourier series of period 12, so that each wavenumber is a plane problem. Lengths are in
thicknesses, forces are 1; stress does not depend on the modulus. `--check` compares a wide strip with the layer that goes on for ever.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path

import numpy as np
import scipy.sparse.linalg
import scipy.special
from skfem import Basis, BilinearForm, ElementQuad2, ElementVector, FacetBasis, LinearForm, MeshQuad, asm

TABLE = Path(__file__).parents[1] / "src" / "palpate" / "bench" / "trust" / "pad_edge.npz"
RATIO, TAXELS, PITCH, HALF, CASES = 0.48, 5, 0.75, 2.5, 40
PERIOD, MODES = 12.0, 40


class Strip:
    """A strip from -``half`` to ``half`` with ``per`` elements a thickness."""

    def __init__(self, half: float, per: int) -> None:
        across = np.linspace(-half, half, round(2 * half * per) + 1)
        mesh = MeshQuad.init_tensor(across, np.linspace(0.0, 1.0, per + 1)).with_boundaries(
            {"top": lambda x: x[1] < 1e-9, "base": lambda x: x[1] > 1 - 1e-9}
        )
        element = ElementVector(ElementQuad2(), 3)  # (x, y, z) over the plane (x, z)
        self.basis = Basis(mesh, element, intorder=5)
        self.base = self.basis.get_dofs("base").flatten()
        self.free = np.setdiff1d(np.arange(self.basis.N), self.base)
        self.top = FacetBasis(mesh, element, facets="top", intorder=12)

        @BilinearForm
        def mass(u, v, _):
            return (u * v).sum(axis=0)

        on_base = FacetBasis(mesh, element, facets="base", intorder=5)
        self.mass = scipy.sparse.linalg.splu(asm(mass, on_base).tocsc()[self.base][:, self.base])
        self.places = self.basis.doflocs[:, self.base]

    def stress(self, contacts: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Stress (contact, direction of the unit force, channel, point) at points (2, point) over corners of elements."""
        out = np.zeros((len(contacts), 3, 3, points.shape[1]))
        at = [np.flatnonzero(np.abs(self.places[0] - x) < 1e-9) for x in points[0]]
        for mode in range(MODES):
            wavenumber = 2 * np.pi * mode / PERIOD
            # loads along x and z: u_x, u_z as cos(k y), u_y as sin(k y); along y: sin, cos, sin, which is the same with -k
            for k, directions in ((wavenumber, (0, 2)), (-wavenumber, (1,))):
                stiffness, factor = self._factor(k)
                for c, direction in itertools.product(range(len(contacts)), directions):
                    x, y, radius = contacts[c]
                    force = self._load(direction, wavenumber, x, radius) * (1.0 if mode == 0 else 2.0) / PERIOD
                    moved = np.zeros(self.basis.N)
                    moved[self.free] = factor.solve(force[self.free])
                    pushed = self.mass.solve(-(stiffness @ moved - force)[self.base])
                    along = wavenumber * (points[1] - y)
                    even, odd = np.cos(along), np.sin(along)
                    for channel in range(3):
                        like = even if (channel == 1) == (direction == 1) else odd
                        out[c, direction, channel] += like * pushed[[p[channel] for p in at]]
        return out

    def _factor(self, k: float):
        mu, lam = 1 / (2 * (1 + RATIO)), RATIO / ((1 + RATIO) * (1 - 2 * RATIO))  # of a modulus of 1

        def strains(u):
            g = u.grad  # (component, along x or z)
            return (
                (g[0, 0], k * u[1], g[2, 1]),
                (g[0, 1] + g[2, 0], g[1, 0] - k * u[0], g[1, 1] - k * u[2]),  # twice the shear strains
            )

        @BilinearForm
        def stiffness(u, v, _):
            (a, b), (c, d) = strains(u), strains(v)
            direct = 2 * mu * sum(p * q for p, q in zip(a, c)) + lam * sum(a) * sum(c)
            return direct + mu * sum(p * q for p, q in zip(b, d))

        whole = asm(stiffness, self.basis).tocsc()
        return whole, scipy.sparse.linalg.splu(whole[self.free][:, self.free])

    def _load(self, direction: int, wavenumber: float, x: float, radius: float) -> np.ndarray:
        """Hertz's pressure of a force of 1, its Fourier transform along y."""

        @LinearForm
        def load(v, w):
            s = np.sqrt(np.clip(radius**2 - (w.x[0] - x) ** 2, 0.0, None))
            # the integral of sqrt(s^2 - y^2) cos(k y)
            part = np.pi / 2 * s**2 if wavenumber == 0 else np.pi * s * scipy.special.j1(wavenumber * s) / wavenumber
            return 1.5 / (np.pi * radius**3) * part * v[direction]

        return asm(load, self.top)


def taxels() -> np.ndarray:
    line = PITCH * (np.arange(TAXELS) - (TAXELS - 1) / 2)
    return np.stack([a.ravel() for a in np.meshgrid(line, line)])  # rows along y, columns along x


def check() -> None:
    """In the middle of a wide strip the base feels what it feels under a layer without end."""
    import palpate as pp

    points = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    found = Strip(5.0, 8).stress(np.array([[0.0, 0.0, 1.0]]), points)[0]
    pad = pp.BondedLayers([pp.Layer(thickness=1.0, youngs_modulus=1.0, poissons_ratio=RATIO)])
    grid = pp.AreaGrid(shape=(161, 161), spacing=1 / 60)
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    skin = pp.Skin(pad, pp.ScatteredArray(positions=points.T, depth=1.0, channels=channels), surface=grid)
    shape = np.sqrt(np.clip(1 - grid.x[None, :] ** 2 - grid.axes[0][:, None] ** 2, 0, None))
    for direction in range(3):
        traction = np.zeros((3, *shape.shape))
        traction[direction] = shape / (shape.sum() * grid.cell)
        print("force along", "xyz"[direction])
        print("  finite elements", np.round(found[direction], 4).tolist())
        print("  endless layer  ", np.round(np.asarray(skin.sense(traction)), 4).tolist())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    if parser.parse_args().check:
        check()
        return
    rng = np.random.default_rng(5)
    radius, gap = rng.uniform(0.5, 1.0, CASES), rng.uniform(0.5, 1.0, CASES)
    contacts = np.stack([HALF - gap - radius, rng.uniform(-0.8, 0.8, CASES), radius], axis=1).round(4)
    readings = Strip(HALF, 8).stress(contacts, taxels())
    readings = readings.reshape(CASES, 3, 3, TAXELS, TAXELS).astype(np.float32)
    np.savez_compressed(TABLE, contacts=contacts, readings=readings)
    print(f"wrote {TABLE}: {readings.shape}, {TABLE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
