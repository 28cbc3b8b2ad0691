"""All numbers and switches of the contact method, each with its reason, in one tree.

A function that decides something takes a `Policy` (or an estimator with a ``policy``) and reads the number from it; no
other file of `inverse/contact` holds one, except `local` and `places`, which are another method. `palpate bench
ablation` walks the fields: it switches off each part, and halves and doubles the numbers marked ``tried``, on contacts
that were not used to tune them. Users choose a method, not these numbers. `numbers` lists them all.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any

__all__ = [
    "STATED",
    "Detection",
    "Discs",
    "Errors",
    "Explanations",
    "Extent",
    "Fit",
    "Grid",
    "Noise",
    "Parts",
    "Policy",
    "Prior",
    "Rims",
    "Screening",
    "Work",
    "changed",
    "numbers",
]

#: Smallest factor by which the calibration constants multiply the model's standard deviations of force and traction
#: (tests/regressions/test_real_readings.py). Errors that the user states or that are assumed are divided by it, so that
#: no constant makes them smaller.
STATED = 0.5


def number(value: Any, why: str, *, tried: bool = False, needs: str = "") -> Any:
    """A number of the policy and its reason ``why``.

    ``tried``: the value is not derived, so the ablation halves and doubles it. ``needs``: what a frame must have for
    the number to matter: "friction" given, "shear" sought, or several "channels".
    """
    return field(default=value, metadata={"why": why, "tried": tried, "needs": needs})


def part(title: str, *, needs: str = "") -> Any:
    """A part of the method that the ablation switches off; ``title`` names it in the table."""
    return field(default=True, metadata={"why": title, "part": True, "needs": needs})


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Parts of the method that can be switched off independently."""

    constraint: bool = part("pressure never pulls, shear within friction")
    even_model: bool = part("model of an even penalty")
    second_derivative: bool = part("model of the second derivative")
    wide_weights: bool = part("local weights, wide")
    narrow_weights: bool = part("local weights, narrow")
    finer_grid: bool = part("finer grid")
    finer_sliding: bool = part("finer grid of sliding contact", needs="friction")
    wide_surface: bool = part("surface beyond the edge")
    sliding: bool = part("sliding as a whole", needs="friction")
    trim: bool = part("trimming of faint cells")
    channel_noise: bool = part("noise of each channel", needs="channels")
    noise_again: bool = part("noise learned again")
    uneven_evidence: bool = part("uneven noise is no contact", needs="channels")
    explains: bool = part("local weights explain the readings")
    outliers: bool = part("outliers left out")
    pulls: bool = part("contact that pulls")
    rims: bool = part("pull about a contact")
    common_shear: bool = part("shear in proportion to the pressure", needs="shear")
    screening: bool = part("broken readings left out before contact is sought")
    nuisances: bool = part("offsets of the readings")
    few_cells: bool = part("contact smaller than a pitch, seen in a few cells")
    compact: bool = part("discs of any place and radius")


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Limits that decide whether there is contact."""

    evidence: float = number(
        6.0,
        "log evidence that contact needs over noise alone, or any explanation over the simplest: odds of 400 to one",
        tried=True,
    )
    few_cells: float = number(
        4.0,
        "gain of contact in a few cells beyond that of heavy-tailed noise: the largest of 400 empty frames was 2.5",
    )
    patch: float = number(
        15.0,
        "log likelihood (half the squared readings that it causes, in units of the noise) that a patch beside a larger one needs: `evidence`, plus the log of a thousand places, plus 2",
    )
    unexplained: float = number(
        3.0,
        "largest root mean square of the residual of a push, in units of the noise: ten readings of noise exceed 2 once in 60 000 frames",
    )
    unexplained_signal: float = number(
        0.03, "in a tracker: residual, as a fraction of the readings, that a push may leave beside noise"
    )
    most_left: float = number(
        0.5, "a contact whose residual is more than this fraction of the readings does not explain them"
    )
    student: float = number(
        2.0,
        "degrees of freedom of Student's distribution, which stands for heavy-tailed noise: its variance is infinite up to 2",
    )
    stands_out: float = number(
        6.0,
        "a reading may be a small contact if it exceeds the median magnitude of its channel by this factor: 4 standard deviations of Gaussian noise",
    )
    short_line: int = number(
        25, "on a line with at most this many taxels and without given noise, seek a contact over all taxels"
    )
    short_line_noise: float = number(0.03, "in this search, the noise starts at this fraction of the readings")
    short_line_left: float = number(
        0.35, "in this search, contact explains the readings if its residual is less than this fraction of them"
    )
    few_readings: int = number(
        50,
        "with at most this many readings, noise learned from the frame does not prove that nothing touches, and a zeroed skin is solved with a discrepancy at once: finer models would fit the errors of the pad (four real skins)",
    )


@dataclass(frozen=True, kw_only=True)
class Explanations:
    """Limits for choosing an explanation: push, pull or both; with or without offsets and ramps; and for replacing one
    that fits poorly.
    """

    doubt: float = number(0.15, "try a pull if the residual of a push is more than this fraction of the readings")
    edge: float = number(
        0.4,
        "if more than this fraction of the cells above the outermost taxels is loaded (one end of a line, two sides of an area), an offset may explain the load",
    )
    ring: float = number(
        0.7,
        "if more than this fraction is loaded, nearly all round, an explanation may fit any readings, and hide an offset",
    )
    nuisance: float = number(
        4.0, "standard deviations from which a nuisance is significant: once in 16 000 frames without one"
    )
    nuisance_rounds: int = number(
        12, "most rounds of solving nuisances and contact in turn: three suffice, or ten if both are hard to separate"
    )
    groups: int = number(3, "most groups of taxels with an offset of their own; they are found one after another")
    per_nuisance: float = number(3.0, "gain that each nuisance needs, and that a sign other than push needs")
    largest_nuisance: float = number(
        0.4, "largest nuisance, as a fraction of the largest reading of its kind without it: sensors are zeroed"
    )
    smallest_nuisance: float = number(
        0.01,
        "smallest nuisance, as a fraction of the largest reading: five times `fit.MODEL_DETAIL`, the accuracy of the model",
    )
    structured: float = number(
        0.1,
        "try contact that pushes and pulls at once if the residual of one sign is more than this fraction of the readings",
    )
    structured_chance: float = number(1e-4, "and if noise leaves as regular a residual with less than this probability")
    everywhere: float = number(
        0.6,
        "if channels cannot separate pressure from shear, reject pressure on more than this fraction of the surface if its residual is more than `structured`",
    )
    half: float = number(
        0.5,
        "one half: examine residuals from half the limit, because an outlier inflates the noise that judges it; on large arrays, leave out those from half the largest too, and skip a sign of less than half the best gain; a line whose ends read less than half of its lowest level has an offset",
    )
    many_taxels: int = number(
        400,
        "an array of this many taxels is large: skip unlikely signs of contact, leave out several outliers at once, and seek no offsets of groups, which took a third of the time of a frame of 32 x 32 x 3",
    )
    bends: float = number(
        0.6,
        "contact without offsets may overfit if it leaves fewer degrees of freedom than this fraction of the readings: pushes that absorbed an offset of 1 to 10 % left 0.30 to 0.55, wide balls without an offset 0.69 and more",
    )
    same: float = number(0.1, "sizes of nuisances that differ by less than this fraction count as equal")
    followed: int = number(2, "most rivals that are solved to replace a rejected explanation")
    least_weight: float = number(0.05, "of two averaged explanations, drop one with less weight than this")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Limits of the fit test, and what a misfit adds to the errors."""

    accepted: float = number(0.05, "misfit probability that a replacement needs: one good frame in twenty is below it")
    doubted: float = number(
        0.1, "below this misfit probability (one good frame in ten), average with a rival, weighted by its odds"
    )
    shows: float = number(
        4.0,
        "log likelihood ratio from which a residual proportional to the readings is significant: one clean frame in 400",
    )
    told: float = number(
        1e-6,
        "drop a direction of drift if contact explains all but this fraction of its square: the residual says nothing about it",
    )
    told_at_size: float = number(2e-5, "the same for large contacts, whose solutions are less accurate")
    many: int = number(
        4096, "with more readings, the test of each model takes a tenth of a frame: stop at the first model that passes"
    )
    loud: int = number(
        1000, "with more readings, allow for drifts up to `fit.MODEL_DETAIL`: they would be detected, but are no misfit"
    )
    prior_weight: float = number(
        4.0, "the prior of the discrepancy, and that of a given noise, count as this many readings"
    )
    shares: tuple[float, ...] = number(
        (0.02, 0.05, 0.1, 0.2, 0.3), "discrepancies to try, in this order, as fractions of the readings"
    )
    faint: float = number(
        3.0,
        "skip solving without discrepancy if the smallest discrepancy is more than this many times the noise of the zero",
    )


@dataclass(frozen=True, kw_only=True)
class Screening:
    """Limits for broken readings, saturation and outliers."""

    deviations: float = number(
        6.0,
        "residual, in standard deviations, from which a reading is an outlier: 2e-9 of Gaussian noise",
        tried=True,
    )
    gross: float = number(
        0.05,
        "and as a fraction of the largest predicted reading: uniform cells alone cause errors of a per cent",
        tried=True,
    )
    broken: float = number(
        8.0,
        "log evidence that leaving out a reading needs, beyond the log of the number of readings: odds of 3000 to one",
    )
    most: float = number(
        0.2, "largest fraction of the readings that may be left out: if there are more, the contact is wrong"
    )
    first_noise: float = number(
        0.3,
        "largest noise to try, as a fraction of the readings: the search goes down to the first level that equals its own residual",
    )
    rounds: int = number(10, "most rounds of this search")
    at_end: int = number(
        2, "this many readings of a channel at its largest or smallest value, each beside another, are saturated"
    )
    at_end_rounded: int = number(4, "the same for rounded readings, whose peaks may have equal values")
    steps: int = number(4096, "readings count as rounded if the largest is at most this many steps: 12 bits")
    dead: float = number(
        0.1, "a reading of zero is dead if the mean of its neighbours is more than this fraction of the largest reading"
    )
    dead_neighbours: float = number(
        0.25, "and if at most this fraction of the neighbours reads zero: at the edge of a dead band half of them do"
    )
    neighbours: int = number(
        3, "this many adjacent outliers that exceed the prediction in one direction are contact, not broken taxels"
    )
    candidates: int = number(4, "residuals examined in each round, largest first; the largest reading is examined too")
    fewest: int = number(6, "do not look for broken readings, or for symmetric ones, among fewer readings than this")
    nearly: float = number(
        1.5,
        "keep a reading if, with a load above its taxel, the residual is less than this many times the residual without the reading",
    )
    explained: float = number(
        0.7,
        "and if that load lowers the squared residual by at least this fraction of what leaving out the reading does",
    )
    outermost: float = number(
        8.0, "an outermost taxel is broken only if it reads more than this many times the largest inner reading"
    )
    outermost_alone: float = number(
        5.0,
        "or, on a large array and not shallow, if its residual exceeds those of its neighbours by this factor: a load beyond the edge gives them a quarter of it",
    )
    alone: float = number(
        4.0, "a reading of more than this many times all others may be broken, whatever a linear model says"
    )
    shallow: float = number(
        0.6, "taxels of less than this depth, in pitches, hardly respond to loads on their neighbours"
    )
    window: tuple[int, int] = number(
        (20, 6), "half-width in taxels of a window of a large array, on a line and on an area"
    )
    window_edge: int = number(
        3, "a reading nearer than this many taxels to an edge inside the array is judged in another window"
    )
    suspicious: float = number(
        5.0,
        "deviation from the interpolated neighbours, in robust standard deviations, from which a reading of a large array is examined",
    )
    suspicious_alone: float = number(1.5, "and this many times the largest deviation three or four taxels away")
    windows: int = number(24, "most windows in a round, largest deviations first")
    window_rounds: int = number(3, "rounds of windows: large outliers hide smaller ones until they are removed")
    open_end: float = number(
        0.15,
        "if this fraction of a channel or more is saturated, the load has no upper bound: below it the intervals of 16 of 16 balls were right",
    )
    excess: float = number(
        0.25,
        "saturated readings may be larger by this fraction divided by `STATED` (standard deviation): two of them double the readings",
    )


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Limits for learning the noise from the frame."""

    fewest: int = number(
        3, "readings that a channel needs for a noise level of its own; a constant channel of more is broken"
    )
    unequal: float = number(
        0.2,
        "log of a channel's noise over the common noise, from which each channel gets its own noise",
        tried=True,
        needs="channels",
    )
    unequal_errors: float = number(
        3.0, "plus this many standard errors: once in 400 frames with equal noise", needs="channels"
    )
    again: float = number(1.2, "estimate the noise again if it changes by more than this factor", tried=True)
    followed: float = number(
        0.05,
        "the linear model fits noise if its noise estimate is less than this fraction of the residual of the contact",
    )
    turns: int = number(
        4, "rounds of estimating the noise of each channel, or noise given up to a factor, and the contact in turn"
    )
    turns_of_all: int = number(2, "the same for one noise level of all channels")
    outlier_rounds: int = number(
        4, "first attempts in which outliers are removed: large ones hide smaller ones until they are removed"
    )
    broken_rounds: int = number(2, "first attempts in which readings of dead taxels and channels are filled in again")
    offset_rounds: int = number(2, "rounds of estimating offsets together with the contact")
    most_offset_rounds: int = number(
        6, "the same if offsets still change by more than `explanations.nuisance` standard deviations"
    )
    step: float = number(
        0.3, "rounding is part of the noise if its standard deviation exceeds this fraction of the given noise"
    )
    attempts: int = number(10, "most rounds of all these steps together; each has its own limit")


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Penalties, and the models that are weighted."""

    shear: float = number(
        0.7,
        "assumed ratio of shear to pressure if friction is unknown: about that of rubber",
        tried=True,
        needs="shear",
    )
    most_friction: float = number(
        1.0,
        "if friction is unknown and channels cannot separate pressure from shear, limit of friction in half of the models",
    )
    even: float = number(
        1.0 / 3.0,
        "weight of the model with an even penalty; local weights have the rest, because neither is known to be better",
        tried=True,
    )
    improbable: float = number(
        0.01, "a penalty is not solved if its odds to the best one are less: its weight would be below a hundredth"
    )
    least_weight: float = number(
        1e-3, "models of less weight are dropped: they would change the mean by a thousandth of their difference"
    )
    reach: float = number(
        1.0 / 3.0, "width (standard deviation) of the wide local mean of squared gradients, in depths", tried=True
    )
    floor: float = number(
        1e-6,
        "smallest local scale relative to the largest: it limits the condition number in double precision",
        tried=True,
    )
    rounds: int = number(4, "rounds of estimating the local weights: each lowers the objective", tried=True)
    larger: tuple[float, ...] = number(
        (1.0, 4.0, 16.0, 64.0), "factors to try on the local scales until contact explains the readings"
    )
    left_more: float = number(
        4.0,
        "local weights may leave a squared residual larger than the first model's by this, or by d + this times sqrt(d), where d are the degrees of freedom that the first model uses",
    )
    ends: float = number(
        0.2,
        "if contact crosses the edge of the surface, weight of models that end there: the objectives differ by a nat or less",
        tried=True,
    )
    slides: float = number(0.03, "a way of sliding of less probability is not solved", tried=True, needs="friction")
    jointly: int = number(
        4, "rounds of estimating the ratio of shear to pressure and the pressure in turn", tried=True, needs="friction"
    )
    sliding_unknowns: int = number(
        450,
        "to test a large contact for sliding, join its cells into blocks with at most this many unknowns in all",
        needs="friction",
    )


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Sizes of cells."""

    line: tuple[int, int] = number((5, 3), "fine cells per surface cell on a line, from low to high noise")
    area: tuple[int, int, int] = number((3, 2, 1), "the same per axis on an area")
    spacing: float = number(
        1.75, "use finer cells if there are fewer taxels per axis and degree of freedom than this", tried=True
    )
    fine_spacing: float = number(
        1.2, "the same for the finest cells on an area: the data then determine the cell of every taxel"
    )
    unknowns: int = number(4000, "most unknowns for finer cells: a factorisation of 4000 takes a second")
    unknowns_per_reading: float = number(
        24.0,
        "most unknowns per reading for finer cells: with 34 a frame of 6 x 6 x 3 took 1.4 to 13 s and had the same error",
    )
    few_unknowns: int = number(1500, "the limit per reading is not applied below this number of unknowns")


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Limits that decide which cells are in contact."""

    faint: float = number(
        0.05,
        "cells with less than this fraction of the peak pressure are not contact; the error bars of a tracker are calibrated with this value",
    )
    margin: int = number(2, "number of cells around a contact that are solved with it, except by the adaptive method")
    trim: float = number(
        2.5,
        "pressure is noise if its fraction of the peak is below this many times noise over the largest reading: 1.2 % of Gaussian noise exceeds it",
        tried=True,
    )
    quiet: float = number(
        1e-3, "cells below this fraction of the largest local scale and of the peak are outside the contact", tried=True
    )
    noisy: float = number(
        0.3, "for noisy frames, the limit of the peak is this many times noise over the largest reading", tried=True
    )
    most_quiet: float = number(0.03, "upper limit of that fraction: less than `faint`")
    at_edge: float = number(
        0.3,
        "if traction at the outermost taxels exceeds this fraction of the largest, contact may continue beyond them",
    )
    goes_on: float = number(
        0.5,
        "if traction beyond them exceeds this fraction, contact crosses the edge; if pressure above all of them reaches it, the load has no bound",
    )


@dataclass(frozen=True, kw_only=True)
class Discs:
    """Limits for contacts of a few taxels."""

    radii: tuple[float, ...] = number(
        (0.5, 1.0, 1.5, 2.25, 3.25, 4.5, 6.0), "radii to try, in cells of the finer grid, up to one pitch"
    )
    at_end: float = number(
        0.8, "if more than this fraction of the weight is at the largest radius, the contact is larger than a disc"
    )
    taxels: tuple[float, float] = number(
        (3.0, 6.0),
        "a contact is small if pressure above half its peak covers at most the area of this many taxels (line, area)",
    )
    drawn: int = number(8, "discs that become models")
    detail: float = number(
        0.015,
        "if noise is not given: accuracy of a disc as a fraction of the largest reading, because real contacts have other edges",
    )
    least: float = number(
        0.02,
        "discs of less total weight are not solved: of 60 ordinary frames, discs have no weight in 40 and all of it in 16",
    )
    most: float = number(0.67, "largest total weight of discs: other shapes are always possible")
    worse: float = number(
        2.0,
        "discs are rejected if their residual exceeds the larger of the noise and the residual of a smooth field by this factor",
    )
    cells: int = number(4000, "with more cells than this, discs are not tried")
    places: int = number(200, "number of places, the best for the third radius, at which all radii are tried")
    best: int = number(24, "number of best discs around which places between cells are tried")
    steps: int = number(3, "interpolation steps per cell on either side")
    halvings: int = number(5, "number of times the search for the best place of each radius halves its step")
    aside: int = number(
        2, "steps to either side that are weighted: four taxels determine a place to a fiftieth of a cell"
    )
    few: int = number(6, "most cells of a contact in a few cells")
    scales: int = number(20, "rounds for the scale of Student's distribution: it converges in ten")


@dataclass(frozen=True, kw_only=True)
class Rims:
    """Limits for pull around a contact."""

    sought: float = number(
        0.2,
        "misfit probability below which a rim is tried if noise was not given, because it may have been learned from the pull",
    )
    evident: float = number(
        12.0, "gain that a rim needs between `fit.accepted` and `sought`: real rims gain 17 to 500, others 11 or less"
    )
    margin: float = number(0.5, "largest width of a rim as a fraction of the contact's radius, plus one cell")
    unknowns: int = number(1500, "most unknowns of a contact with a rim: without bounds all of them are solved for")
    cancel: float = number(
        3.0,
        "reject the result if its traction exceeds that of the push by this factor: pushes and pulls then cancel in the readings",
    )


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Error contributions other than noise, and limits for notes."""

    force: float = number(5e-4, "smallest relative error of the net force: pad and grid are not more accurate")
    force_at_size: float = number(
        4e-3, "the same for contacts too large for matrices: balls on 64 x 64 and 128 x 128 taxels were 0.2 % off"
    )
    sums_at_size: float = number(
        1.25,
        "factor on the standard deviations of force, moment and centre of such contacts: in 12 frames of 128 x 128, errors were 1.2 standard deviations",
    )
    beyond: float = number(
        0.5,
        "fraction of the possible load outside the outermost taxels that, divided by `STATED`, is its standard deviation in the errors of moment and centre: two of them cover all of it",
    )
    much: float = number(
        0.1, "note if this fraction of the load rests on one taxel, lies outside the array, or may be drift"
    )
    hangs: float = number(
        0.4, "note if this fraction of the normal force rests on one reading: a fifth of clean frames exceed it"
    )
    stands_out: float = number(
        4.0, "standard deviations from which a reading, or the sum of squares of many, is more than noise"
    )
    beside: float = number(1.5, "taxels within this many pitches are neighbours, diagonal ones included")
    even_press: float = number(
        0.2,
        "an even press explains offsets if its residual is less than this fraction of them; components above it have no bound",
    )
    hidden_drift: float = number(
        0.1,
        "standard deviation of an offset that a loaded edge hides, and of drift of displacements, as a fraction of the largest reading: two of them are half of `largest_nuisance`",
    )
    ambiguous_force: float = number(
        0.05,
        "least relative error of the normal force if channels cannot separate pressure from shear: 1 to 4 % at 0.5 mm depth (docs/_generated/in_plane.md)",
    )
    ambiguous_coupled: float = number(0.02, "the same if friction is given: 1 to 2 % there")
    ambiguous_shear: float = number(
        0.005,
        "error of the shear force in that case, as a fraction of the normal force: 0.1 to 0.8 % was found without shear",
    )
    ambiguous_peak: float = number(
        0.035,
        "in that case, the relative error of the peak is this times 1/a - 1/`ambiguous_shape`, half of it if friction is given; a is the effect of pressure over that of shear",
    )
    ambiguous_shape: float = number(
        0.2,
        "above this a, the shape of the pressure is determined: peaks are 0.9 to 1 of the true ones from 0.5 mm below the surface",
    )
    most_ambiguous: float = number(
        0.8, "largest relative error of the peak: markers on the surface show 0.1 to 0.5 of it"
    )
    ambiguous_cells: float = number(
        2.7, "factor on this error for a single cell, because its calibration constants are smaller by this factor"
    )


@dataclass(frozen=True, kw_only=True)
class Work:
    """Problem sizes at which the method switches to another algorithm or leaves a step out."""

    unknowns: int = number(9000, "most unknowns of a frame: a dense normal matrix of 650 MB")
    second_order: int = number(
        4096, "most readings for which the second derivative is tried: its spectrum doubles the cost"
    )
    hold: int = number(
        4096, "with more readings, local weights are not tested: the data alone determine where contact is"
    )
    likely: float = number(0.15, "start with the cells above this fraction of the linear solution's peak: saves time")
    cell_rounds: int = number(12, "rounds of adding cells")
    few_cells: float = number(
        0.02, "stop adding cells if those missing are next to the others and at most this fraction of them"
    )
    entries: int = number(
        2_000_000, "search all cells for contact in a few cells if their columns have at most this many entries"
    )
    nearest: int = number(
        9, "otherwise only those nearest to the largest residual that these entries allow, but at least this many"
    )
    finest: int = number(
        10_000,
        "use cells of half the size for this search, to place the load within a cell, if they are at most this many",
    )
    blocks: int = number(32, "blocks (`prior.sliding_unknowns`) whose products are computed together")
    trace: float = number(1e-6, "noise added to readings if every channel is constant, as a fraction of each")


@dataclass(frozen=True, kw_only=True)
class Policy:
    """The numbers of the contact method, grouped by purpose.

    Examples
    --------
    >>> from palpate.inverse.contact.policy import Policy, changed
    >>> changed(Policy(), "detection.evidence", 9.0).detection.evidence
    9.0
    """

    parts: Parts = field(default_factory=Parts)
    detection: Detection = field(default_factory=Detection)
    explanations: Explanations = field(default_factory=Explanations)
    fit: Fit = field(default_factory=Fit)
    screening: Screening = field(default_factory=Screening)
    noise: Noise = field(default_factory=Noise)
    prior: Prior = field(default_factory=Prior)
    grid: Grid = field(default_factory=Grid)
    extent: Extent = field(default_factory=Extent)
    discs: Discs = field(default_factory=Discs)
    rims: Rims = field(default_factory=Rims)
    errors: Errors = field(default_factory=Errors)
    work: Work = field(default_factory=Work)


@dataclass(frozen=True)
class Number:
    """One number or switch; ``name`` is "section.field" within `Policy`."""

    name: str
    value: Any
    why: str
    part: bool
    tried: bool
    needs: str


def numbers(policy: Policy | None = None) -> Iterator[Number]:
    """All numbers and switches of a policy (default: the method's own)."""
    whole = policy or Policy()
    for section in fields(whole):
        group = getattr(whole, section.name)
        for f in fields(group):
            m = f.metadata
            yield Number(
                f"{section.name}.{f.name}",
                getattr(group, f.name),
                m["why"],
                m.get("part", False),
                m.get("tried", False),
                m.get("needs", ""),
            )


def changed(policy: Policy, name: str, value: Any) -> Policy:
    """A copy of the policy with one number changed; ``name`` is "section.field"."""
    section, _, entry = name.partition(".")
    return replace(policy, **{section: replace(getattr(policy, section), **{entry: value})})
