"""Combine all frames of a recording: the growth of the contact, and findings that use every frame."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.elastic.pad import Floats
from palpate.identify.findings import Finding, IdentifiedPress
from palpate.identify.frame import Frame
from palpate.identify.objects import NORMAL, Contact, contact, contact_findings, identified, modulus_std
from palpate.identify.shapes import BALL, FLAT

__all__ = ["combine_frames", "joint_shape"]

#: Smallest number of frames, and smallest ratio of the largest to the smallest force, for a fit of the growth of a
#: contact.
FEWEST, SPAN = 3, 2.0


def joint_shape(frames: Sequence[Frame], odds: float) -> str:
    """Return the most likely shape over all frames with a single contact, whose noise is independent."""
    gain = 0.0
    for frame in frames:
        if frame.best is not None and frame.other is not None:
            sign = 1.0 if frame.best.shape == BALL else -1.0
            scale = max(1.0, frame.best.squares / max(frame.best.freedom, 1))
            gain += sign * 0.5 * (frame.other.squares - frame.best.squares) / scale
    return (BALL if gain > 0 else FLAT) if abs(gain) > odds else ""


def combine_frames(frames: Sequence[Frame], depths: Floats, shape: str) -> IdentifiedPress:
    """Combine all frames. Frames with another shape were fitted again with this ``shape``."""
    ones = [
        (i, f)
        for i, f in enumerate(frames)
        if f.best is not None and len(f.best.radii) == 1 and f.shape == (shape or f.shape)
    ]
    each = tuple(identified(f) for f in frames)
    found = [(i, contact(f)) for i, f in ones if f.best is not None and f.best.forces[0, -1] > 0]
    growth = _growth(found)
    if not found:
        why = "no frame has a single contact that was fitted"
        return IdentifiedPress(each, growth, shape, *(Finding.unknown(u, why) for u in ("m", "Pa", "Pa", "N/m")))
    told = [contact_findings(c) for _, c in found]
    if not shape:
        why = "a ball and a flat fit the frames equally well"
        three = [Finding.unknown(u, why) for u in ("m", "Pa", "Pa")]
    else:
        three = [_mean([t[n] for t in told], [_shared(c) for _, c in found]) for n in range(3)]
    largest = int(np.argmax([c.force for _, c in found]))
    stiffness = _slope([(float(depths[i]), c.force, c.std[1]) for i, c in found]) or told[largest][3]
    return IdentifiedPress(each, growth, shape, three[0], three[1], three[2], stiffness)


def _shared(found: Contact) -> float:
    """Return the error that all frames share, which averaging does not reduce (standard deviation of the log)."""
    by = sum((s * (3.0 * math.log(a / found.radius) - math.log(f / found.force))) ** 2 for a, f, s in found.shifts)
    return math.hypot(math.sqrt(by), modulus_std(found))


def _mean(findings: Sequence[Finding], shared: Sequence[float]) -> Finding:
    """Return the weighted mean of the logs. Independent errors decrease with the number of frames, shared ones do not."""
    known = [(f, s) for f, s in zip(findings, shared) if f.known and f.low > 0 and math.isfinite(f.high)]
    if not known:
        return max(findings, key=lambda f: f.low if math.isfinite(f.low) else -math.inf)
    value = np.log([f.value for f, _ in known])
    half = np.array([0.5 * math.log(f.high / f.low) for f, _ in known])
    common = NORMAL * float(np.median([s for _, s in known]))
    alone = np.sqrt(np.maximum(half**2 - common**2, (0.05 * half) ** 2))
    weight = alone**-2 / (alone**-2).sum()
    mean = float(weight @ value)
    spread = float((((value - mean) / (alone / NORMAL)) ** 2).sum()) / max(len(value) - 1, 1)
    end = math.hypot(common, math.sqrt(max(spread, 1.0) / float((alone**-2).sum())))
    return Finding(math.exp(mean), math.exp(mean - end), math.exp(mean + end), known[0][0].unit, known[0][0].reason)


def _growth(found: Sequence[tuple[int, Contact]]) -> Finding:
    each = [c for _, c in found if c.ends[0] is not None and c.ends[1] is not None]
    if len(each) < FEWEST:
        return Finding.unknown(
            "1", f"{len(each)} frames determine the size of a single contact; the growth needs {FEWEST}"
        )
    force = np.log([c.force for c in each])
    if math.exp(float(np.ptp(force))) < SPAN:
        return Finding.unknown(
            "1", f"the forces differ by a factor of {math.exp(float(np.ptp(force))):.2g}; the growth needs {SPAN:g}"
        )
    radius = np.log([c.radius for c in each])
    std = np.array([0.5 * math.log(c.ends[1][0] / c.ends[0][0]) / NORMAL for c in each])  # type: ignore[index]
    return _line(force, radius, std, "1")


def _line(x: Floats, y: Floats, std: Floats, unit: str) -> Finding:
    """Return the slope of y over x."""
    weight = std**-2
    middle = float((weight * x).sum() / weight.sum())
    spread = float((weight * (x - middle) ** 2).sum())
    slope = float((weight * (x - middle) * y).sum() / spread)
    start = float((weight * (y - slope * (x - middle))).sum() / weight.sum())
    left = float((weight * (y - start - slope * (x - middle)) ** 2).sum()) / max(len(x) - 2, 1)
    half = NORMAL * math.sqrt(max(left, 1.0) / spread)
    return Finding(slope, slope - half, slope + half, unit)


def _slope(rows: Sequence[tuple[float, float, float]]) -> Finding | None:
    """Return dF/d(indentation) at the largest force, from the exponent m in F ~ indentation^m; None with too few
    indentations.
    """
    known = [r for r in rows if math.isfinite(r[0]) and r[0] > 0 and r[1] > 0]
    if len(known) < FEWEST or max(r[0] for r in known) < 1.2 * min(r[0] for r in known):
        return None
    depth, force, std = (np.array(part) for part in zip(*known))
    power = _line(np.log(depth), np.log(force), std, "1")
    top = int(np.argmax(force))
    scale = float(force[top] / depth[top])
    return Finding(
        power.value * scale, power.low * scale, power.high * scale, "N/m", f"force ~ indentation^{power.value:.2f}"
    )
