"""Hooke's law, compression positive."""

from __future__ import annotations

from typing import Any

from palpate.elastic.half_space import check_material
from palpate.errors import NotObservable

__all__ = ["stress_from_strains"]


def stress_from_strains(
    strain_xx: Any, strain_zz: Any, *, youngs_modulus: float, poissons_ratio: float
) -> tuple[Any, Any]:
    """Stress from two measured strains in plane strain (equation 7 of the founding paper).

        s_xx = E/((1+nu)(1-2nu)) [(1-nu) e_xx + nu e_zz]
        s_zz = E/((1+nu)(1-2nu)) [nu e_xx + (1-nu) e_zz]

    Parameters
    ----------
    strain_xx, strain_zz : arrays of one shape
        Normal strains, compression positive.
    youngs_modulus, poissons_ratio : float
        E [Pa] and nu of the material at the measuring depth; nu < 0.5.

    Returns
    -------
    stress_xx, stress_zz : arrays [Pa]

    Raises
    ------
    NotObservable
        At nu = 0.5: an incompressible material transmits any uniform pressure without any strain, so the two
        strains (then e_xx = -e_zz) fix the difference s_zz - s_xx but not either stress.

    Examples
    --------
    >>> import palpate as pp
    >>> xx, zz = pp.stress_from_strains(0.0, 0.01, youngs_modulus=1e5, poissons_ratio=0.25)
    >>> round(xx), round(zz)  # 1 % of compression between rigid walls [Pa]
    (400, 1200)
    """
    check_material(youngs_modulus, poissons_ratio)
    nu = poissons_ratio
    if nu == 0.5:
        raise NotObservable(
            "stress cannot be computed from two strains at poissons_ratio = 0.5: an incompressible material carries "
            "any hydrostatic pressure without strain (1 - 2 nu = 0), so e_xx = -e_zz fixes only s_zz - s_xx. "
            "Measure a stress, or reconstruct the traction from the strains (Skin.reconstruct), whose net force is "
            "then unknown."
        )
    factor = youngs_modulus / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return (
        factor * ((1.0 - nu) * strain_xx + nu * strain_zz),
        factor * (nu * strain_xx + (1.0 - nu) * strain_zz),
    )
