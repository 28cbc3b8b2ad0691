"""From the states of one wavevector to the quantities a sensor can feel, in x, y, z."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from palpate.elastic.half_space import Floats, Pad
from palpate.errors import InvalidInput

__all__ = ["AREA_CHANNELS", "LINE_CHANNELS", "channel_unit", "check_channels", "mirror_parity", "transfer"]

_TENSOR = ("xx", "yy", "zz", "xz", "yz", "xy")

#: Every channel of area contact (three dimensions).
AREA_CHANNELS: tuple[str, ...] = (
    *(f"displacement_{i}" for i in "xyz"),
    *(f"stress_{ij}" for ij in _TENSOR),
    *(f"strain_{ij}" for ij in _TENSOR),
)

#: The channels that do not vanish identically in line contact (plane strain).
LINE_CHANNELS: tuple[str, ...] = (
    "displacement_x",
    "displacement_z",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_xz",
    "strain_xx",
    "strain_zz",
    "strain_xz",
)

#: Traction components, in the order of the component axis.
COMPONENTS: dict[int, tuple[str, ...]] = {1: ("x", "z"), 2: ("x", "y", "z")}


def channel_unit(channel: str) -> str:
    """SI unit of a channel: "m" for displacement, "Pa" for stress, "1" for strain."""
    return {"displacement": "m", "stress": "Pa", "strain": "1"}[channel.split("_")[0]]


def check_channels(channels: Sequence[str], dimensions: int) -> tuple[str, ...]:
    """The channels as a tuple, or `InvalidInput` naming the bad one and what is accepted."""
    if isinstance(channels, str):
        raise InvalidInput(f'channels must be a list of names; got the string {channels!r}. Write ["{channels}"].')
    accepted = LINE_CHANNELS if dimensions == 1 else AREA_CHANNELS
    found = tuple(channels)
    if not found:
        raise InvalidInput(f"channels is empty: name at least one of {', '.join(accepted)}.")
    for name in found:
        if name not in accepted:
            why = "vanishes identically in line contact (plane strain)" if name in AREA_CHANNELS else "is not a channel"
            raise InvalidInput(f"channel {name!r} {why}; accepted: {', '.join(accepted)}.")
    if len(set(found)) != len(found):
        raise InvalidInput(f"channels names one channel twice: {', '.join(found)}.")
    return found


def mirror_parity(name: str, axis: str) -> int:
    """+1 or -1: the sign of a channel (or traction component) when coordinate ``axis`` is mirrored."""
    return -1 if name.split("_")[-1].count(axis) % 2 else 1


def transfer(
    pad: Pad,
    wavevector_x: npt.ArrayLike,
    wavevector_y: npt.ArrayLike,
    depth: float,
    channels: Sequence[str],
    *,
    line: bool = False,
) -> npt.NDArray[np.complex128]:
    """The matrix of one wavevector: channel per unit surface traction.

    For a traction t(x) = t0 exp(i k.x) on z = 0 the channels at ``depth`` are M(k) t0 exp(i k.x).

    Parameters
    ----------
    pad : Pad
        The elastic body.
    wavevector_x, wavevector_y : array_like
        Components of the wavevector [rad/m], broadcast together; line contact is wavevector_y = 0.
        k = 0 is returned as the mean over all directions of the limit k -> 0 in stress and strain (what a load
        spread wide in every direction gives). Displacement is finite on a rigid base, and NaN over a half-space, where it
        has no limit: the caller must have a policy for it.
    depth : float
        Depth below the surface [m], >= 0.
    channels : sequence of str
        Names from `AREA_CHANNELS`.
    line : bool
        Line contact: only decides which directions the limit at k = 0 is averaged over.

    Returns
    -------
    array (..., channel, 3), complex
        Columns for (q_x, q_y, p) [m/Pa, Pa/Pa or 1/Pa].
    """
    kx, ky = np.broadcast_arrays(np.asarray(wavevector_x, dtype=np.float64), np.asarray(wavevector_y, dtype=np.float64))
    k = np.hypot(kx, ky)
    zero = k == 0.0
    safe = np.where(zero, 1.0, k)
    cos, sin = np.where(zero, 1.0, kx / safe), np.where(zero, 0.0, ky / safe)
    matrix = _rotated(pad, k, safe, cos, sin, depth, channels)
    if np.any(zero):
        matrix[zero] = _mean_response(pad, depth, channels, line=line)
    return matrix


def _mean_response(pad: Pad, depth: float, channels: Sequence[str], *, line: bool) -> npt.NDArray[np.complex128]:
    angles = np.array([0.0, np.pi]) if line else np.arange(8) * (np.pi / 4.0)
    k = np.zeros_like(angles)
    limit = _rotated(pad, k, np.ones_like(k), np.cos(angles), np.sin(angles), depth, channels).mean(axis=0)
    limit[np.abs(limit) < 1e-15 * np.abs(limit).max(initial=0.0)] = 0.0
    mean = pad.mean_compliance(depth)
    for row, name in enumerate(channels):
        if name.startswith("displacement"):
            limit[row] = np.nan if mean is None else 0.0
            if mean is not None:
                column = "xyz".index(name[-1])
                limit[row, column] = mean[1] if column == 2 else mean[0]
    return limit


def _rotated(
    pad: Pad, k: Floats, safe: Floats, cos: Floats, sin: Floats, depth: float, channels: Sequence[str]
) -> npt.NDArray[np.complex128]:
    mu, nu = pad.material(depth)
    b, c = nu / (1.0 - nu), (1.0 - 2.0 * nu) / (2.0 * mu * (1.0 - nu))
    states = pad.states(k, depth)
    # surface values from traction: S0 = -i q_r, N0 = p, T0 = q_t; q_r = cos q_x + sin q_y, q_t = cos q_y - sin q_x
    zeros = np.zeros_like(k)
    s0 = np.stack([-1j * cos, -1j * sin, zeros], axis=-1)
    n0 = np.stack([zeros, zeros, np.ones_like(k)], axis=-1)
    t0 = np.stack([-sin, cos, zeros], axis=-1)

    def in_plane(row: int) -> npt.NDArray[np.complex128]:
        a = states.in_plane[row]
        return np.asarray(a[0][..., None] * s0 + a[1][..., None] * n0)

    ku, kuz, shear, normal = (in_plane(i) for i in range(4))
    kut, trans = (states.antiplane[i][..., None] * t0 for i in range(2))
    co, si = cos[..., None], sin[..., None]

    # tensors in the frame of the wavevector: rr, tt, zz, rz, tz, rt
    stress_rr = 2.0 * mu / (1.0 - nu) * ku + b * normal
    stress = (stress_rr, nu * (stress_rr + normal), normal, 1j * shear, trans, -1j * mu * kut)
    half = 1.0 / (2.0 * mu)
    strain = (ku, 0.0 * ku, c * normal - b * ku, 1j * half * shear, half * trans, -0.5j * kut)

    out = np.empty((*k.shape, len(channels), 3), dtype=np.complex128)
    for row, name in enumerate(channels):
        kind, index = name.split("_")
        if kind == "displacement":
            along, across = 1j * ku, kut
            scaled = {"x": co * along - si * across, "y": si * along + co * across, "z": kuz}[index]
            out[..., row, :] = scaled / safe[..., None]
            continue
        rr, tt, zz, rz, tz, rt = stress if kind == "stress" else strain
        if index == "xx":
            out[..., row, :] = co**2 * rr + si**2 * tt - 2.0 * co * si * rt
        elif index == "yy":
            out[..., row, :] = si**2 * rr + co**2 * tt + 2.0 * co * si * rt
        elif index == "xy":
            out[..., row, :] = co * si * (rr - tt) + (co**2 - si**2) * rt
        elif index == "xz":
            out[..., row, :] = co * rz - si * tz
        elif index == "yz":
            out[..., row, :] = si * rz + co * tz
        else:
            out[..., row, :] = zz
    return out
