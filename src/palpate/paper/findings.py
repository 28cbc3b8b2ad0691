"""Claims of the paper in our words, with our numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate._arrays import irfftn
from palpate.elastic.hooke import stress_from_strains
from palpate.elastic.pad import Floats
from palpate.errors import NotObservable
from palpate.paper.algorithm import discrete_kernel, divide, even_part, half_width, transform
from palpate.paper.cases import DEPTH, PAD, PITCH, SENSORS, array, data, mean_error
from palpate.paper.formulas import kernel_transforms, kernels, line_force
from palpate.paper.studies import (
    CHANNELS,
    FRICTIONLESS,
    Row,
    error_table,
    friction_table,
    noise_study,
    speed_study,
    truncation_study,
)
from palpate.sensing.arrays import AreaArray, LineArray
from palpate.skin import Skin
from palpate.solutions import hertz_line, hertz_point

__all__ = ["Claim", "claims"]


@dataclass(frozen=True)
class Claim:
    """A result that the paper claims, in our words, and what we find.

    Attributes
    ----------
    where : str
        Section of the paper.
    says, finds : str
    holds : str
        "yes", "no", "in part" or "open then": it was open then, and is solved here.
    timed : bool
        The numbers depend on the machine.
    """

    where: str
    says: str
    finds: str
    holds: str = "yes"
    timed: bool = False


def claims(
    *,
    errors: Sequence[Row] | None = None,
    friction: Sequence[Row] | None = None,
    noise: Sequence[Row] | None = None,
    truncation: Sequence[Row] | None = None,
    speed: Sequence[Row] | None = None,
) -> list[Claim]:
    """One row for each claimed result; tables that were made already can be given."""
    errors = error_table() if errors is None else errors
    friction = friction_table() if friction is None else friction
    noise = noise_study() if noise is None else noise
    truncation = truncation_study() if truncation is None else truncation
    speed = speed_study() if speed is None else speed
    return [*_physics(), *_transforms(), *_accuracy(errors, friction, truncation), *_discussion(noise, speed)]


def _physics() -> list[Claim]:
    x = array(["stress_zz"]).grid.x
    pressed = data("punch", "stress_zz")
    far = np.array([20.0, 40.0])
    stress = line_force(far, DEPTH, vertical=1.0)
    falls = [float(-np.log2(s[1] / s[0])) for s in stress[:2]]
    strains = [kernels(c, DEPTH, x)[0] for c in ("strain_xx", "strain_zz")]
    together = float(np.abs(strains[0] + strains[1]).max() / np.abs(strains[1]).max())
    try:
        stress_from_strains(*strains, youngs_modulus=1.0, poissons_ratio=0.5)
        answer = "given"
    except NotObservable:
        answer = "refused"
    widths = {c: _width(c, 0.99) for c in CHANNELS}
    return [
        Claim(
            "1",
            "Below the surface the stress is smaller, so a fragile sensor is safer in a soft layer.",
            f"Rectangle: peak {pressed[0][1].max():.3f} on the surface, {pressed[1].max():.3f} at z = {DEPTH}: "
            f"{pressed[0][1].max() / pressed[1].max():.1f} times less.",
        ),
        Claim(
            "2",
            "The normal stress along the depth decays faster with y than the one along the surface; therefore it is used.",
            f"Between y = 20 and 40 it falls like y to the power −{falls[0]:.2f}, the one along the surface −{falls[1]:.2f}.",
        ),
        Claim(
            "2",
            "At ν = 0.5 the two strains do not give the stress: they are opposite.",
            f"Largest sum over largest strain: {_small(together)}; palpate's equation 7 at ν = 0.5: {answer}.",
        ),
        Claim(
            "3",
            "Even a narrow load changes the readings far away, so the array must be wider than the contact.",
            f"Line force: 99 % of the area under |K1| lies within |y| < {widths['stress_zz']:.1f} (stress) and "
            f"{widths['strain_zz']:.0f} (strain).",
        ),
    ]


def _width(channel: str, share: float) -> float:
    """Half the width that holds a share of the integral of |K1|, to the sample."""
    y = np.arange(0.0, 20_000.0, 0.05)
    total = np.cumsum(np.abs(kernels(channel, DEPTH, y)[0]))
    return float(y[np.searchsorted(total, share * total[-1])])


def _transforms() -> list[Claim]:
    omega = 2 * np.pi * np.arange(SENSORS // 2 + 1) / (SENSORS * PITCH)
    differences: dict[str, Floats] = {}
    zero: dict[str, float] = {}
    for channel in CHANNELS:
        discrete = transform(discrete_kernel(channel, SENSORS)).real
        differences[channel] = np.abs(discrete - kernel_transforms(channel, DEPTH, omega)[0].real)
        zero[channel] = float(discrete[0])
    circular = 0.0
    for case, channel in FRICTIONLESS:
        true, _ = data(case, channel)
        spectrum = transform(true[1]) * transform(discrete_kernel(channel, SENSORS))
        readings = np.roll(np.asarray(irfftn(spectrum, (SENSORS,))), SENSORS // 2)
        circular = max(circular, mean_error(divide(readings, channel), true[1]))
    return [
        Claim(
            "3.1",
            "The DFT of K1 nearly equals its Fourier transform, except for strain at k = 0. There the truncation of the array makes it differ from 0, so division is possible.",
            f"Largest difference: stress {differences['stress_zz'].max():.1e}; strain {zero['strain_zz']:.3f} at k = 0 (the transform is 0), "
            f"{differences['strain_zz'][1:].max():.3f} elsewhere.",
            "in part",
        ),
        Claim(
            "4",
            "Truncation of the array is one source of the error.",
            f"In double precision and without friction it is the only source: from periodic data, division recovers the pressure to {_small(circular)}.",
        ),
    ]


def _accuracy(errors: Sequence[Row], friction: Sequence[Row], truncation: Sequence[Row]) -> list[Claim]:
    e = {(r["case"], r["channel"]): r for r in errors}
    f = {(r["component"], r["channel"]): r for r in friction}
    t = {(r["case"], r["channel"], r["sensors"]): r["division"] for r in truncation}
    ratios = [e[c, "strain_zz"]["division"] / e[c, "stress_zz"]["division"] for c in ("cylinder", "punch")]
    ratios += [f[c, "strain_zz"]["M found"] / f[c, "stress_zz"]["M found"] for c in ("vertical", "tangential")]
    shares = {}
    for channel in CHANNELS:
        _, readings = data("cylinder", channel)
        outside = np.abs(array([channel]).grid.x) > 10.0
        shares[channel] = float(np.abs(readings[0, outside]).sum() / np.abs(readings).sum())
    edges, found = [], []
    for channel in CHANNELS:
        true, readings = data("punch with friction", channel)
        even = divide(even_part(readings[0]), channel)
        edges.append(float(np.abs(even[true[1] == 0.0]).max() / even.max()))
        found.append(half_width(even))
    worst = max(float(r["division"]) for r in errors)
    return [
        Claim(
            "3.1, 4",
            "The reconstructed traction is very near the designed one.",
            f"Largest mean absolute error without friction {worst:.2e}, at peaks of 0.12 and 0.31; the linear system: "
            f"{_small(max(float(r['linear system']) for r in errors))}.",
        ),
        Claim(
            "3.2",
            "The even part of the readings gives the half-width M.",
            f"Yes: beyond the contact the pressure of the even part is at most {edges[0]:.0e} (stress) and {edges[1]:.0e} (strain) of its peak, "
            f"so any threshold above that gives M = {found[0]} and {found[1]}.",
        ),
        Claim(
            "4",
            "With M, vertical and tangential stress follow from one channel.",
            f"Mean errors with M as found: from stress {f['vertical', 'stress_zz']['M found']:.1e} and {f['tangential', 'stress_zz']['M found']:.1e}, "
            f"from strain {f['vertical', 'strain_zz']['M found']:.1e} and {f['tangential', 'strain_zz']['M found']:.1e}; the same algorithm on "
            f"the linear system: {_small(max(float(r['linear system']) for r in friction))}.",
        ),
        Claim(
            "4",
            "Strain gives larger errors than stress in all cases.",
            "Strain over stress: cylinder "
            + ", rectangle ".join(f"{r:.0f}" for r in ratios[:2])
            + f", with friction {ratios[2]:.0f} (vertical) and {ratios[3]:.0f} (tangential) times.",
        ),
        Claim(
            "4",
            "Strain spreads wider than stress.",
            f"Cylinder: {100 * shares['stress_zz']:.2f} % of the stress reading (absolute, summed) lies beyond |y| = 10, "
            f"{100 * shares['strain_zz']:.0f} % of the strain reading.",
        ),
        Claim(
            "4",
            "So truncation to 41 sensors costs strain more.",
            f"Cylinder: from stress {t['cylinder', 'stress_zz', 121]:.1e} to {t['cylinder', 'stress_zz', 41]:.1e}, from strain "
            f"{t['cylinder', 'strain_zz', 121]:.1e} to {t['cylinder', 'strain_zz', 41]:.1e}. With 21 sensors the order is reversed: "
            f"{t['cylinder', 'stress_zz', 21]:.1e} and {t['cylinder', 'strain_zz', 21]:.1e}.",
        ),
    ]


def _discussion(noise: Sequence[Row], speed: Sequence[Row]) -> list[Claim]:
    n = {(r["case"], r["channel"], r["noise"]): r for r in noise}
    quiet, loud = n["punch", "stress_zz", 0.0], n["cylinder", "stress_zz", 1e-3]
    smooth = n["cylinder", "stress_zz", 0.0]
    first = speed[0]
    return [
        Claim(
            "6",
            "Division is faster than one of Hilgers' regularisation methods.",
            f"{first['sensors']} sensors: {1e3 * first['division, each']:.2f} ms a frame against {1e3 * first['Hilgers, each']:.2f} ms, "
            f"{first['Hilgers over division']:.1f} times as long with the parameter chosen on every frame.",
            timed=True,
        ),
        Claim(
            "6",
            "Without noise it is more accurate too.",
            f"Rectangle from stress, relative error {quiet['division']:.0e} against {quiet['Hilgers']:.2f}: a smooth norm blunts its edges. "
            f"Cylinder: {smooth['division']:.0e} against {_small(smooth['Hilgers'])}: where noise is learned, none below 2e-4 of the largest "
            "reading is believed. The paper does not say which of his methods it used.",
            "yes",
        ),
        Claim(
            "6",
            "With noise it is much more sensitive, however small the noise.",
            f"Cylinder from stress at 0.1 % noise: relative error {loud['division']:.2f} against {loud['Hilgers']:.3f}; at 1 %: "
            f"{n['cylinder', 'stress_zz', 1e-2]['division']:.1f} against {n['cylinder', 'stress_zz', 1e-2]['Hilgers']:.2f}.",
        ),
        _network(),
        _two_planes(),
        _three_dimensions(),
    ]


def _network() -> Claim:
    true, readings = data("cylinder", "stress_zz")
    skin = Skin(PAD, array(["stress_zz"]))
    noisy = readings + 0.01 * np.abs(readings).max() * np.random.default_rng(0).standard_normal(readings.shape)
    found = {}
    for name, touch in (
        ("network", skin.reconstruct(noisy, method="network", components=["z"])),
        ("dft", skin.reconstruct(noisy, method="dft", components=["z"])),
    ):
        margin = (touch.surface.shape[0] - SENSORS) // 2
        values = np.asarray(touch.values)[1, margin : margin + SENSORS]
        found[name] = float(np.linalg.norm(values - true[1]) / np.linalg.norm(true[1]))
    return Claim(
        "6",
        "Analog networks can solve the problem in parallel, of interest for real time.",
        f'Simulated (method="network"): cylinder from stress at 1 % noise, relative error {found["network"]:.3f}; division {found["dft"]:.1f}.',
    )


def _two_planes() -> Claim:
    contact = hertz_line(half_width=4.0, force=1.0).partial_slip(0.5, 0.3)

    def skin(depths: Sequence[float]) -> Skin:
        return Skin(PAD, [LineArray(count=SENSORS, pitch=PITCH, depth=d, channels=["stress_zz"]) for d in depths])

    one = skin([DEPTH])
    try:
        one.reconstruct(one.sense(contact), components=["x", "z"], method="tikhonov")
        answer = "one plane gives an answer"
    except NotObservable:
        answer = "one plane is refused as not enough"
    two = skin([1.0, 2.0])
    touch = two.reconstruct(two.sense(contact), components=["x", "z"], method="tikhonov")
    true = np.asarray(two.sample(contact))
    relative = [float(np.linalg.norm(a - b) / np.linalg.norm(b)) for a, b in zip(np.asarray(touch.values), true)]
    return Claim(
        "6",
        "Open: general shear; sensors on two planes may help.",
        f"They do: partial slip from stress at z = 1 and 2, relative error of the shear {relative[0]:.3f}, of the pressure {relative[1]:.4f}, "
        f"net shear {float(np.asarray(touch.force)[0]):.3f} for 0.3; {answer}.",
        "open then",
    )


def _three_dimensions() -> Claim:
    channels = ["stress_xz", "stress_yz", "stress_zz"]
    skin = Skin(PAD, AreaArray(shape=(16, 16), pitch=PITCH, depth=1.0, channels=channels))
    contact = hertz_point(contact_radius=2.5, force=1.0).sliding(0.4)
    touch = skin.reconstruct(skin.sense(contact), method="tikhonov")
    true: Any = np.asarray(skin.sample(contact))
    error = float(np.linalg.norm(np.asarray(touch.values) - true) / np.linalg.norm(true))
    force = np.asarray(touch.force)
    return Claim(
        "6",
        "Open: three dimensions need a more complex model.",
        f"The same matrix with one row more: a ball that slides on 16 × 16 × 3 stresses, relative error {error:.3f}, "
        f"force {force[0]:.3f}, {abs(force[1]):.3f}, {force[2]:.3f} for 0.4, 0, 1.",
        "open then",
    )


def _small(value: float) -> str:
    """Only the order of magnitude, since rounding differs from machine to machine."""
    return "below 1e-9" if 1e-13 < value < 1e-9 else "below 1e-13" if value <= 1e-13 else f"{value:.1e}"
