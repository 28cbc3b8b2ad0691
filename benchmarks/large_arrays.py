"""How often a frame of a large array is wrong without a word: faults on 24 x 24 to 128 x 128 taxels.

    python benchmarks/large_arrays.py [--seed 0] [--frames 10] [--sizes 24,32] [--rows clean,offset,...] [--limit 60] [--keep FILE] [--each]
    python benchmarks/large_arrays.py --table FILE ... [--write]

The readings do not come from palpate. Each contact is a lattice of point loads, no coarser than a third of the depth, and the readings are the
sums of the closed forms of Boussinesq and Cerruti (K. L. Johnson, Contact Mechanics, section 3.6) for a half-space. The true force is the sum of
the point loads. The true pressure of a cell is the mean of the contact's profile at 64 points of the cell. This file was written without reading
how palpate solves a frame; it calls only the public interface.

Each frame has its own sensor: pitch 0.5 to 4 mm, depth 0.7 to 2.5 pitches, points or taxels of 0.6 of a pitch (up to 32 x 32), three components of
stress (seven in ten), normal stress alone, or displacement. In half of the frames the noise is given (0.2 to 5 % of the largest reading). Contacts:
balls, punches, blocks, several of these, wide ones; without shear, sliding, or with partial slip. Frame k of a row is the same whatever other
rows are run.

Wrong: the net force is off by more than 30 % of the load. Far outside: a component of the true force lies beyond its 95 % interval by more than half
of the interval's half-width. A word: a status other than "solved" and "no contact", a fit below 0.01, a force that is not a number, an interval of
the normal force wider than the load, or a note that warns. Notes that only report a nuisance that was removed, or readings that were left out, do
not count as a word. Wrong without a word: wrong or far outside, and no word; a frame with the note that the force is uncertain counts as well if it
is far outside. Gross: also off by more than 30 % and beyond the interval by more than its width. A needless word: a word on a right frame. Without
contact, a frame is wrong if it is solved and the interval of the normal force does not reach 0. A frame that takes longer than ``--limit`` seconds
of processor time counts as not in time. Peaks of punches are not counted: their rims are narrower than the depth. The time includes the
preparation of the sensor and the intervals; the memory is the largest of the process.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

import palpate as pp
from palpate import Status

TABLE = Path(__file__).parent.parent / "docs" / "_generated" / "large_arrays.md"
Floats = np.ndarray

#: Notes that begin so report what was found and removed.
REPORTS = ("offset of", "ramp of", "shift of", "rotation of", "left out as unexplained", "no contact:")
UNCERTAIN = "the net force is uncertain"

# ---------------------------------------------------------------------------------------------------------------- contacts


@dataclass
class Contact:
    """A pressure profile on an ellipse or a rectangle, with shear."""

    shape: str
    x: float
    y: float
    a: float
    b: float
    angle: float
    peak: float
    friction: float = 0.0
    direction: float = 0.0
    slip: float = 0.0
    wave: float = 0.0

    def pressure(self, x: Floats, y: Floats) -> Floats:
        return self.peak * self._shape(*self._local(x, y))

    def traction(self, x: Floats, y: Floats) -> Floats:
        """(q_x, q_y, p), each shaped like x: shear is that of Cattaneo and Mindlin, whose stuck ellipse is ``slip`` as wide as the contact."""
        u, v = self._local(x, y)
        p = self.peak * self._shape(u, v)
        q = p.copy()
        if self.slip:
            q -= self.slip * self.peak * self._shape(u / self.slip, v / self.slip)
        q *= self.friction
        return np.array([q * math.cos(self.direction), q * math.sin(self.direction), p])

    def reach(self) -> float:
        return math.hypot(self.a, self.b) if self.shape == "block" else max(self.a, self.b)

    def _local(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        c, s = math.cos(self.angle), math.sin(self.angle)
        return ((x - self.x) * c + (y - self.y) * s) / self.a, ((y - self.y) * c - (x - self.x) * s) / self.b

    def _shape(self, u: Floats, v: Floats) -> Floats:
        r2 = u * u + v * v
        if self.shape == "ball":
            return np.sqrt(np.clip(1.0 - r2, 0.0, None))
        if self.shape == "soft":
            return np.clip(1.0 - r2, 0.0, None) ** 1.5
        if self.shape == "punch":
            return np.where(r2 < 1.0, 0.3 / np.sqrt(np.clip(1.0 - 0.91 * r2, 0.05, None)), 0.0)
        if self.shape == "block":
            return np.where(np.maximum(np.abs(u), np.abs(v)) < 1.0, 1.0, 0.0)
        waves = 1.0 + 0.5 * np.cos(self.wave * u) * np.cos(self.wave * v)
        return np.sqrt(np.clip(1.0 - r2, 0.0, None)) * waves / 1.5


def loads(contact: Contact, spacing: float) -> tuple[Floats, Floats, Floats]:
    """x, y and (F_x, F_y, F_z) of point loads on a lattice; [m], [N]."""
    reach, h = contact.reach(), min(spacing, min(contact.a, contact.b) / 10)
    n = math.ceil(2 * reach / h)
    t = (np.arange(n) + 0.5) / n * 2 * reach - reach
    x, y = (g.ravel() for g in np.meshgrid(contact.x + t, contact.y + t))
    force = contact.traction(x, y) * (2 * reach / n) ** 2
    on = force[2] > 0
    return x[on], y[on], force[:, on]


def one(rng: np.random.Generator, side: float, depth: float, shape: str | None = None, size: tuple[float, float] = (0.08, 0.25)) -> Contact:
    """A contact inside the array; ``size``: its half-width, in sides of the array."""
    shape = shape or str(rng.choice(["ball", "ball", "soft", "punch", "block"]))
    a = side * math.exp(rng.uniform(*np.log(size)))
    b = a * rng.uniform(0.6, 1.0)
    room = max(0.45 * side - a, 0.0)
    x, y = rng.uniform(-room, room, 2)
    contact = Contact(shape, x, y, a, b, rng.uniform(0, math.pi), 1.0, wave=rng.uniform(2.0, 8.0))
    kind = rng.choice(["none", "sliding", "partial"])
    if kind != "none":
        contact.friction, contact.direction = rng.uniform(0.1, 0.8), rng.uniform(0, 2 * math.pi)
        contact.slip = rng.uniform(0.2, 0.8) if kind == "partial" and shape == "ball" else 0.0
    return contact


def any_contact(rng: np.random.Generator, side: float, depth: float) -> list[Contact]:
    kind = rng.choice(["one", "one", "one", "several", "wide"])
    return {"one": lambda: [one(rng, side, depth)], "several": lambda: several(rng, side, depth), "wide": lambda: wide(rng, side, depth)}[kind]()


def several(rng: np.random.Generator, side: float, depth: float) -> list[Contact]:
    found = []
    for _ in range(rng.integers(2, 6)):
        contact = one(rng, side, depth, size=(0.06, 0.14))
        contact.peak = rng.uniform(0.3, 1.0)
        found.append(contact)
    return found


def wide(rng: np.random.Generator, side: float, depth: float) -> list[Contact]:
    """A press of 0.6 to 1.1 times the array's width."""
    return [one(rng, side, depth, shape=str(rng.choice(["ball", "soft", "waves", "block"])), size=(0.3, 0.55))]


def across(rng: np.random.Generator, side: float, depth: float) -> list[Contact]:
    """A press across the edge of the array, with its centre above the array."""
    contact = one(rng, side, depth, size=(0.1, 0.3))
    contact.x = float(rng.choice([-1, 1])) * (0.5 * side - rng.uniform(0.0, 0.7) * contact.b)
    return [contact]


# ---------------------------------------------------------------------------------------------------------------- closed forms


def stresses(x: Floats, y: Floats, z: float, force: Floats) -> Floats:
    """(s_xz, s_yz, s_zz) at (x, y, z) below point loads at the origin, summed over the last axis; compression positive."""
    r2 = x * x + y * y + z * z
    along = (force[0] * x + force[1] * y + force[2] * z) * 1.5 * z / (math.pi * r2 * r2 * np.sqrt(r2))
    return np.array([(along * x).sum(-1), (along * y).sum(-1), z * along.sum(-1)])


def displacements(x: Floats, y: Floats, z: float, force: Floats, shear_modulus: float, nu: float) -> Floats:
    """(u_x, u_y, u_z) at (x, y, z) below point loads at the origin, summed over the last axis."""
    r = np.sqrt(x * x + y * y + z * z)
    near, soft = r + z, 1.0 - 2.0 * nu
    dot = force[0] * x + force[1] * y
    side = dot / r**3 - soft * dot / (r * near**2) + force[2] * (z / r**3 - soft / (r * near))
    diagonal = 1.0 / r + soft / near
    u = [x * side + force[0] * diagonal, y * side + force[1] * diagonal]
    u.append(force[2] * (z * z / r**3 + 2.0 * (1.0 - nu) / r) + dot * (z / r**3 + soft / (r * near)))
    return np.array([part.sum(-1) for part in u]) / (4.0 * math.pi * shear_modulus)


@dataclass
class Sensor:
    n: int
    pitch: float
    depth: float
    aperture: float
    channels: list[str]
    modulus: float
    nu: float

    @property
    def side(self) -> float:
        return self.n * self.pitch

    def read(self, contacts: list[Contact]) -> tuple[Floats, Floats]:
        """Readings (channel, y, x), and the net force (F_x, F_y, F_z)."""
        parts = [loads(contact, self.depth / 3) for contact in contacts]
        lx, ly, force = (np.concatenate(p, axis=-1) for p in zip(*parts, strict=True))
        t = (np.arange(self.n) - (self.n - 1) / 2) * self.pitch
        points = [(0.0, 1.0)]
        if self.aperture:
            nodes, weights = np.polynomial.legendre.leggauss(3)
            points = [(0.5 * self.aperture * u, 0.5 * w) for u, w in zip(nodes, weights, strict=True)]
        found = np.zeros((3, self.n, self.n))
        rows = max(1, int(4e6 / (self.n * lx.size)))
        for first in range(0, self.n, rows):
            for dy, wy in points:
                for dx, wx in points:
                    x = (t + dx)[None, :, None] - lx
                    y = (t[first : first + rows] + dy)[:, None, None] - ly
                    x, y = np.broadcast_arrays(x, y)
                    if self.channels[0].startswith("stress"):
                        field = stresses(x, y, self.depth, force)
                    else:
                        field = displacements(x, y, self.depth, force, self.modulus / (2 * (1 + self.nu)), self.nu)
                    found[:, first : first + rows] += wx * wy * field
        return found[[i for i, c in enumerate("xyz") if any(k.endswith(c) if k[0] == "d" else k[-2] == c for k in self.channels)]], force.sum(-1)


def any_sensor(rng: np.random.Generator, n: int) -> Sensor:
    kind = rng.choice(["stress", "normal", "displacement"], p=[0.7, 0.15, 0.15])
    channels = {
        "stress": ["stress_xz", "stress_yz", "stress_zz"],
        "normal": ["stress_zz"],
        "displacement": ["displacement_x", "displacement_y", "displacement_z"],
    }[kind]
    pitch = 1e-3 * math.exp(rng.uniform(math.log(0.5), math.log(4.0)))
    aperture = 0.6 * pitch if n <= 32 and rng.random() < 0.4 and kind != "displacement" else 0.0
    modulus, nu = 10 ** rng.uniform(4.5, 6.0), float(rng.choice([0.5, 0.48, 0.4]))
    return Sensor(n, pitch, pitch * rng.uniform(0.7, 2.5), aperture, channels, modulus, nu)


# ---------------------------------------------------------------------------------------------------------------- faults


@dataclass
class Frame:
    """What the program is given, and what is true."""

    sensor: Sensor
    contacts: list[Contact]
    force: Floats
    readings: Floats
    noise: float
    given: float | None
    largest: float
    zero: Floats | None = None
    limits: tuple[float, float] | None = None
    said: list[str] = field(default_factory=list)


Fault = Callable[[Frame, np.random.Generator], None]


def plane(frame: Frame, angle: float) -> Floats:
    t = np.linspace(-0.5, 0.5, frame.sensor.n)
    return (math.cos(angle) * t[None, :] + math.sin(angle) * t[:, None]) / max(abs(math.cos(angle)), abs(math.sin(angle)))


def signs(rng: np.random.Generator, n: int) -> Floats:
    return rng.choice([-1.0, 1.0], n)


def offset(frame: Frame, rng: np.random.Generator) -> None:
    """All readings, or each channel, off by 5 to 30 % of the largest."""
    channels = frame.readings.shape[0]
    size = rng.uniform(0.05, 0.3, channels) * signs(rng, channels)
    size = size if rng.random() < 0.5 else np.full(channels, size[0])
    frame.readings += frame.largest * size[:, None, None]


def ramp(frame: Frame, rng: np.random.Generator) -> None:
    """A ramp in each channel, 5 to 30 % of the largest reading from one side to the other."""
    for channel in frame.readings:
        channel += frame.largest * rng.uniform(0.05, 0.3) * plane(frame, rng.uniform(0, 2 * math.pi))


def gains(frame: Frame, rng: np.random.Generator) -> None:
    """Gains of taxels spread by 3 to 10 %."""
    frame.readings *= 1.0 + rng.uniform(0.03, 0.1) * rng.standard_normal(frame.readings.shape)


def clipped(frame: Frame, rng: np.random.Generator) -> None:
    """Readings end at 50 to 90 % of the largest, and nobody says so."""
    level = rng.uniform(0.5, 0.9) * frame.largest
    frame.readings = np.clip(frame.readings, -level, level)


def clipped_named(frame: Frame, rng: np.random.Generator) -> None:
    """Readings end at 50 to 90 % of the largest, and the array says so."""
    level = rng.uniform(0.5, 0.9) * frame.largest
    frame.readings, frame.limits = np.clip(frame.readings, -level, level), (-level, level)


def dead_block(frame: Frame, rng: np.random.Generator) -> None:
    """A block of 2 x 2 to 6 x 6 taxels reads 0, or a constant of up to 30 % of the largest reading."""
    n = frame.sensor.n
    height, width = rng.integers(2, 7, 2)
    y, x = rng.integers(0, n - height), rng.integers(0, n - width)
    frame.readings[:, y : y + height, x : x + width] = 0.0 if rng.random() < 0.6 else rng.uniform(-0.3, 0.3) * frame.largest


def bad_row(frame: Frame, rng: np.random.Generator) -> None:
    """One row or column is dead, stuck, off by 10 to 40 % of the largest reading, or ten times as noisy; of one channel or of all."""
    i = int(rng.integers(0, frame.sensor.n))
    channels = slice(None) if rng.random() < 0.6 else slice(*(lambda c: (c, c + 1))(int(rng.integers(0, frame.readings.shape[0]))))
    part = frame.readings[channels, i, :] if rng.random() < 0.5 else frame.readings[channels, :, i]
    kind = rng.choice(["dead", "stuck", "off", "noisy"])
    if kind == "dead":
        part[...] = 0.0
    elif kind == "stuck":
        part[...] = rng.uniform(-0.5, 0.5) * frame.largest
    elif kind == "off":
        part += rng.uniform(0.1, 0.4) * float(rng.choice([-1, 1])) * frame.largest
    else:
        part += 10 * frame.noise * rng.standard_normal(part.shape)


def drift(frame: Frame, rng: np.random.Generator) -> None:
    """Ten frames at rest are given; since then the zero moved by a smooth pattern of 2 to 15 % of the largest reading."""
    frame.zero = frame.noise * rng.standard_normal((10, *frame.readings.shape))
    zero = 0.3 * frame.largest * rng.standard_normal(frame.readings.shape)
    frame.zero += zero
    frame.readings += zero
    t = np.linspace(-1, 1, frame.sensor.n)
    for channel in frame.readings:
        c = rng.standard_normal(6)
        x, y = t[None, :], t[:, None]
        pattern = c[0] + c[1] * x + c[2] * y + 0.5 * (c[3] * x * x + c[4] * y * y + c[5] * x * y)
        channel += rng.uniform(0.02, 0.15) * frame.largest * pattern / np.abs(pattern).max()


def outliers(frame: Frame, rng: np.random.Generator) -> None:
    """0.3 to 3 % of the readings are anything up to 1.5 times the largest."""
    bad = rng.random(frame.readings.shape) < rng.uniform(0.003, 0.03)
    frame.readings[bad] = rng.uniform(-1.5, 1.5, int(bad.sum())) * frame.largest


def noise_too_small(frame: Frame, rng: np.random.Generator) -> None:
    """The noise given is a half to a fifth of the true one."""
    frame.given = frame.noise * rng.uniform(0.2, 0.5)


def noise_too_large(frame: Frame, rng: np.random.Generator) -> None:
    """The noise given is two to five times the true one."""
    frame.given = frame.noise * rng.uniform(2.0, 5.0)


def correlated(frame: Frame, rng: np.random.Generator) -> None:
    """Further noise that neighbours share, over one to three pitches, one to three times as large as the noise."""
    for channel in frame.readings:
        smooth = ndimage.gaussian_filter(rng.standard_normal(channel.shape), rng.uniform(0.7, 2.0), mode="wrap")
        channel += frame.noise * rng.uniform(1.0, 3.0) * smooth / smooth.std()


def heavy_tails(frame: Frame, rng: np.random.Generator) -> None:
    """Further noise with Student's distribution of two degrees of freedom."""
    frame.readings += frame.noise * rng.standard_t(2, frame.readings.shape)


def mixed(frame: Frame, rng: np.random.Generator) -> None:
    """Two or three of: offset, ramp, gains, clipped, dead block, bad row, outliers, correlated."""
    choices: list[Fault] = [ramp, gains, offset, clipped, dead_block, bad_row, outliers, correlated]
    for i in sorted(rng.choice(len(choices), int(rng.integers(2, 4)), replace=False)):
        choices[i](frame, rng)


def nothing(frame: Frame, rng: np.random.Generator) -> None:
    """Nothing but noise is wrong."""


@dataclass
class Row:
    what: str
    contacts: Callable[[np.random.Generator, float, float], list[Contact]] | None
    fault: Fault

    @property
    def clean(self) -> bool:
        return self.fault is nothing


ROWS = {
    "clean": Row("contacts inside the array, nothing but noise", any_contact, nothing),
    "wide": Row("a contact of 0.6 to 1.1 times the array's width", wide, nothing),
    "punch": Row("a flat punch with a sharp rim", lambda r, s, d: [one(r, s, d, "punch")], nothing),
    "several": Row("two to five contacts", several, nothing),
    "across": Row("a contact across the edge, its centre above the array", across, nothing),
    "empty": Row("nothing touches", None, nothing),
    "empty, offset": Row("nothing touches; offsets", None, offset),
    "offset": Row("", any_contact, offset),
    "ramp": Row("", any_contact, ramp),
    "gains": Row("", any_contact, gains),
    "clipped": Row("", any_contact, clipped),
    "clipped named": Row("", any_contact, clipped_named),
    "dead block": Row("", any_contact, dead_block),
    "bad row": Row("", any_contact, bad_row),
    "drift": Row("", any_contact, drift),
    "outliers": Row("", any_contact, outliers),
    "noise too small": Row("", any_contact, noise_too_small),
    "noise too large": Row("", any_contact, noise_too_large),
    "correlated noise": Row("", any_contact, correlated),
    "heavy tails": Row("", any_contact, heavy_tails),
    "mixed": Row("", any_contact, mixed),
}


def make(name: str, n: int, seed: int, k: int) -> Frame:
    """Frame k of a row."""
    row = ROWS[name]
    rng = np.random.default_rng([seed, list(ROWS).index(name), n, k])
    sensor = any_sensor(rng, n)
    contacts = row.contacts(rng, sensor.side, sensor.depth) if row.contacts else []
    strength = sensor.modulus * rng.uniform(0.01, 0.08)
    for contact in contacts:
        contact.peak *= strength
        if sensor.channels == ["stress_zz"]:
            contact.friction = 0.0
    if contacts:
        readings, force = sensor.read(contacts)
        largest = float(np.abs(readings).max())
    else:
        readings, force = np.zeros((len(sensor.channels), n, n)), np.zeros(3)
        largest = strength if sensor.channels[0].startswith("stress") else 0.05 * sensor.pitch
    noise = largest * math.exp(rng.uniform(math.log(0.002), math.log(0.05)))
    readings = readings + noise * rng.standard_normal(readings.shape)
    frame = Frame(sensor, contacts, force, readings, noise, noise if rng.random() < 0.5 else None, largest)
    row.fault(frame, rng)
    return frame


# ---------------------------------------------------------------------------------------------------------------- running and judging


class TooLong(Exception):
    pass


def _stop(*_: object) -> None:
    raise TooLong


def solve(frame: Frame, limit: float) -> dict[str, Any]:
    """What palpate makes of a frame, beside the truth."""
    s = frame.sensor
    pad = pp.HalfSpace(youngs_modulus=s.modulus, poissons_ratio=s.nu)
    record: dict[str, Any] = {"true": frame.force.tolist()}
    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, limit)
    start = time.process_time()
    try:
        array = pp.AreaArray(
            shape=(s.n, s.n), pitch=s.pitch, depth=s.depth, channels=s.channels, aperture=s.aperture,
            noise=frame.given if frame.zero is None else None, limits=frame.limits,
        )  # fmt: skip
        # The pad is as described and the readings are calibrated: the intervals hold what the frame itself leaves open.
        skin = pp.Skin(pad, array, uncertainty=pp.Uncertainty(youngs_modulus=0.0, scale=0.01))
        touch = skin.reconstruct(frame.readings, **({} if frame.zero is None else {"zero": frame.zero}))
        low, high = touch.interval(0.95, of="force")
        peak_low, peak_high = touch.interval(0.95, of="peak_pressure")
        cell_low, cell_high = touch.interval(0.95)
    except TooLong:
        return record | {"late": True, "time": time.process_time() - start}
    except pp.PalpateError as error:
        return record | {"refused": str(error), "time": time.process_time() - start}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    record["time"] = time.process_time() - start
    components = list(touch.traction.component.values)
    at = ["xyz".index(c) for c in components]
    force = np.zeros(3)
    force[at] = np.asarray(touch.force)
    truth = pressure_of(frame, np.asarray(touch.pressure.x), np.asarray(touch.pressure.y))
    p, p_low, p_high = (np.asarray(v)[components.index("z")] for v in (touch.traction, cell_low, cell_high))
    loaded = truth > 0.05 * truth.max() if frame.contacts else np.zeros(truth.shape, bool)
    record |= {
        "status": Status(int(touch.status)).label, "fit": math.nan if touch.fit is None else float(touch.fit), "notes": [str(n) for n in touch.notes], "force": force.tolist(),
        "low": [float(v) for v in low], "high": [float(v) for v in high], "at": at,
        "load": load_of(frame), "peak": float(touch.peak_pressure), "peak_interval": [float(peak_low), float(peak_high)],
        "true_peak": true_peak(frame, truth),
        "cells": float(np.mean((p_low <= truth) & (truth <= p_high), where=loaded)) if loaded.any() else None,
        "error": float(np.linalg.norm(p - truth) / np.linalg.norm(truth)) if frame.contacts else None,
    }  # fmt: skip
    return record


def pressure_of(frame: Frame, x: Floats, y: Floats) -> Floats:
    """Mean true pressure of each cell."""
    dx, dy = x[1] - x[0], y[1] - y[0]
    total = np.zeros((y.size, x.size))
    t = (np.arange(8) + 0.5) / 8 - 0.5
    for contact in frame.contacts:
        for u in t:
            for v in t:
                total += contact.pressure(x[None, :] + u * dx, y[:, None] + v * dy) / 64
    return total


def true_peak(frame: Frame, cells: Floats) -> float | None:
    """Largest pressure of the profiles; None where a rim or an overlap makes it narrower than the depth."""
    if any(c.shape == "punch" for c in frame.contacts):
        return None
    best = 0.0
    for c in frame.contacts:
        t = np.linspace(-1, 1, 41) * c.reach()
        x, y = np.meshgrid(c.x + t, c.y + t)
        best = max(best, float(sum(other.pressure(x, y) for other in frame.contacts).max()))
    return best


def load_of(frame: Frame) -> float:
    """Integral of the traction's magnitude [N]."""
    return sum(float(np.linalg.norm(loads(c, frame.sensor.depth / 3)[2], axis=0).sum()) for c in frame.contacts)


@dataclass
class Verdict:
    off: float
    beyond: float
    word: bool
    uncertain: bool

    @property
    def wrong(self) -> bool:
        return self.off > 0.3 or self.far

    @property
    def far(self) -> bool:
        return self.beyond > 0.5

    @property
    def silent(self) -> bool:
        return not self.word and (self.far or (self.off > 0.3 and not self.uncertain))


def judge(record: dict[str, Any]) -> Verdict:
    """How far off, how far beyond the interval [half-widths], and whether a word was said."""
    at = record["at"]
    truth, force = np.array(record["true"]), np.array(record["force"])
    low, high = np.array(record["low"]), np.array(record["high"])
    load = record["load"]
    with np.errstate(invalid="ignore", divide="ignore"):
        half = 0.5 * (high - low)
        past = np.maximum(low - truth[at], truth[at] - high)
        beyond = np.where(past <= 0, 0.0, past / half)
    beyond = float(np.nanmax(beyond, initial=0.0))
    off = float(np.linalg.norm((force - truth)[at]) / load) if load else 0.0
    warned = [n for n in record["notes"] if not n.startswith(REPORTS) and not n.lower().startswith(UNCERTAIN)]
    uncertain = any(n.lower().startswith(UNCERTAIN) for n in record["notes"])
    word = record["status"] not in ("solved", "no contact") or record["fit"] < 0.01 or bool(warned) or not np.isfinite(force).all()
    width = float(high[-1] - low[-1])
    word = word or (load > 0 and not width <= load)
    return Verdict(off if math.isfinite(off) else math.inf, beyond, word, uncertain)


# ---------------------------------------------------------------------------------------------------------------- tables


def rows_of(records: list[dict[str, Any]]) -> Iterator[str]:
    yield (
        "| row | frames | wrong by > 30 % / without a word | force far outside 95 % / without a word | wrong without a word / gross | coverage at 95 %: force, peak, "
        "cells | needless words | force error p50, p90 | field error | time p50, max [s] |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for name in [r for r in ROWS if any(x["row"] == r for x in records)]:
        yield _row(name, [r for r in records if r["row"] == name])
    yield _row("all", records)


def _row(name: str, records: list[dict[str, Any]]) -> str:
    done = [r for r in records if "status" in r]
    verdicts = [judge(r) for r in done]
    wrong, far = [v for v in verdicts if v.off > 0.3], [v for v in verdicts if v.far]
    silent = [v for v in verdicts if v.silent]
    gross = [v for v in silent if v.off > 0.3 and v.beyond > 2.0]
    inside = [v.beyond == 0 for r, v in zip(done, verdicts, strict=True)]
    peaks = [r["peak_interval"][0] <= r["true_peak"] <= r["peak_interval"][1] for r in done if r["true_peak"] and math.isfinite(r["peak"])]
    cells = [r["cells"] for r in done if r["cells"] is not None]
    needless = sum(v.word and not v.wrong for v in verdicts)
    errors = [v.off for r, v in zip(done, verdicts, strict=True) if r["load"]]
    fields = [r["error"] for r in done if r["error"] is not None]
    times = [r["time"] for r in records]
    notes = [f"{count} {word}" for count, word in ((sum("late" in r for r in records), "not in time"), (sum("refused" in r for r in records), "refused")) if count]
    quiet = lambda found: f"{len(found)} / {sum(v.silent for v in found)}"  # noqa: E731
    mean = lambda values: f"{np.mean(values):.2f}" if values else "-"  # noqa: E731
    spread = f"{np.median(errors):.3f}, {np.quantile(errors, 0.9):.3f}" if errors else "-"
    return (
        f"| {name} | {len(records)}{' (' + ', '.join(notes) + ')' if notes else ''} | {quiet(wrong)} | {quiet(far)} | {len(silent)} / {len(gross)} | "
        f"{mean(inside)}, {mean(peaks)}, {mean(cells)} | {needless} | {spread} | {f'{np.median(fields):.2f}' if fields else '-'} | "
        f"{np.median(times):.1f}, {np.max(times):.1f} |"
    )


def sizes_of(records: list[dict[str, Any]]) -> Iterator[str]:
    yield "| size | frames | wrong without a word | time p50, p90, max [s] | not in time | memory [MiB] |"
    yield "|---|---|---|---|---|---|"
    for n in sorted({r["n"] for r in records}):
        mine = [r for r in records if r["n"] == n]
        times = [r["time"] for r in mine]
        silent = sum(judge(r).silent for r in mine if "status" in r)
        p50, p90 = np.quantile(times, [0.5, 0.9])
        memory = max(r["memory"] for r in mine)
        yield f"| {n} x {n} | {len(mine)} | {silent} | {p50:.1f}, {p90:.1f}, {max(times):.1f} | {sum('late' in r for r in mine)} | {memory:.0f} |"


def meanings() -> Iterator[str]:
    yield "| row | what is wrong |"
    yield "|---|---|"
    for name, row in ROWS.items():
        yield f"| {name} | {(row.what or str(row.fault.__doc__)).strip().rstrip('.')} |"


def table(records: list[dict[str, Any]]) -> str:
    seeds = ", ".join(str(s) for s in sorted({r["seed"] for r in records}))
    counts = "; ".join(f"{sum(r['n'] == n for r in records)} of {n} x {n}" for n in sorted({r["n"] for r in records}))
    head = f"Made by `python benchmarks/large_arrays.py`, seed {seeds}: {counts}."
    return "\n".join([head, "", *rows_of(records), "", *sizes_of(records), "", *meanings()]) + "\n"


def main() -> None:
    ask = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ask.add_argument("--seed", type=int, default=0)
    ask.add_argument("--frames", type=int, default=10, help="frames of each row and size")
    ask.add_argument("--first", type=int, default=0)
    ask.add_argument("--sizes", default="24,32")
    ask.add_argument("--rows", default=",".join(r.replace(", ", "_") for r in ROWS), help="rows, separated by commas; 'empty_offset' is 'empty, offset'")
    ask.add_argument("--limit", type=float, default=60.0, help="processor seconds of a frame")
    ask.add_argument("--keep", type=Path, help="append each frame to this file, a line of JSON each")
    ask.add_argument("--each", action="store_true", help="print each frame")
    ask.add_argument("--table", type=Path, nargs="+", help="make the table of these files instead")
    ask.add_argument("--write", action="store_true", help=f"write it to {TABLE.name}")
    options = ask.parse_args()
    records: list[dict[str, Any]] = []
    if options.table:
        records = [json.loads(line) for path in options.table for line in path.read_text().splitlines()]
    else:
        names = [name.replace("_", ", ") for name in options.rows.split(",")]
        for n in map(int, options.sizes.split(",")):
            for k in range(options.first, options.first + options.frames):
                for name in names:
                    frame = make(name, n, options.seed, k)
                    record = {"row": name, "n": n, "seed": options.seed, "k": k} | solve(frame, options.limit)
                    record["memory"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                    records.append(record)
                    if options.keep:
                        with options.keep.open("a") as file:
                            file.write(json.dumps(record) + "\n")
                    if options.each:
                        print(_line(record), flush=True)
    text = table(records)
    print(text)
    if options.write:
        TABLE.write_text(text)


def _line(record: dict[str, Any]) -> str:
    start = f"{record['row']:16s} {record['n']:3d} {record['k']:3d} {record['time']:6.1f} s "
    if "status" not in record:
        return start + ("not in time" if "late" in record else record["refused"])
    v = judge(record)
    mark = "SILENT" if v.silent else "wrong" if v.wrong else ""
    return start + f"{record['status']:11s} fit {record['fit']:.3f} off {v.off:.3f} beyond {v.beyond:.2f} {mark:6s} {record['notes']}"


if __name__ == "__main__":
    main()
