"""Contacts, closed forms and faults of `large_arrays.py`: frames of large arrays whose readings do not come from palpate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy import ndimage

Floats = np.ndarray

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


def one(
    rng: np.random.Generator,
    side: float,
    depth: float,
    shape: str | None = None,
    size: tuple[float, float] = (0.08, 0.25),
) -> Contact:
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
    return {
        "one": lambda: [one(rng, side, depth)],
        "several": lambda: several(rng, side, depth),
        "wide": lambda: wide(rng, side, depth),
    }[kind]()


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
        rows = max(1, int(2e5 / (self.n * lx.size)))
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
        return found[
            [i for i, c in enumerate("xyz") if any(k.endswith(c) if k[0] == "d" else k[-2] == c for k in self.channels)]
        ], force.sum(-1)


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
    return (math.cos(angle) * t[None, :] + math.sin(angle) * t[:, None]) / max(
        abs(math.cos(angle)), abs(math.sin(angle))
    )


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
    frame.readings[:, y : y + height, x : x + width] = (
        0.0 if rng.random() < 0.6 else rng.uniform(-0.3, 0.3) * frame.largest
    )


def bad_row(frame: Frame, rng: np.random.Generator) -> None:
    """One row or column is dead, stuck, off by 10 to 40 % of the largest reading, or ten times as noisy; of one channel or of all."""
    i = int(rng.integers(0, frame.sensor.n))
    channels = (
        slice(None)
        if rng.random() < 0.6
        else slice(*(lambda c: (c, c + 1))(int(rng.integers(0, frame.readings.shape[0]))))
    )
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
