"""All numbers and switches of the contact method, each with its reason, in one tree.

A function that decides something takes a `Policy` (or an estimator with a ``policy``) and reads the number from it; no
other file of `inverse/contact` holds a limit that the ablation varies, except `local` and `places`, which are another
method. `palpate bench
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
        "log evidence for contact over noise, or for an explanation over the simplest: odds of 400 to one",
        tried=True,
    )
    in_few_cells: float = number(
        4.0, "gain over heavy-tailed noise that contact in a few cells needs: the largest of 400 empty frames was 2.5"
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
        0.03, "fraction of the readings that a push may leave in a tracker, beside noise"
    )
    most_left: float = number(0.5, "contact with a residual above this fraction of the readings does not explain them")
    student: float = number(
        2.0, "degrees of freedom of Student's distribution for heavy-tailed noise; up to 2, variance is infinite"
    )
    stands_out: float = number(
        6.0,
        "a reading may be a small contact if it exceeds the median magnitude of its channel by this factor: 4 standard deviations of Gaussian noise",
    )
    short_line: int = number(25, "if noise is unknown, try contact over all taxels of a line with at most this many")
    short_line_noise: float = number(0.03, "in this search, the noise starts at this fraction of the readings")
    short_line_left: float = number(
        0.35, "such a contact explains the readings if its residual is below this fraction of them"
    )
    few_readings: int = number(
        50,
        "with at most this many readings, noise learned from the frame does not prove that nothing touches, and on a zeroed skin a fit must leave `fit.proves` degrees of freedom: finer models would fit the errors of the pad (four real skins)",
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
    whole_edge: float = number(
        0.7,
        "above this fraction, nearly all round, contact may fit any readings and hide an offset: without it 93 instead of 98 % of wide presses with offsets were inside their interval",
    )
    nuisance: float = number(
        4.0, "standard deviations from which a nuisance is significant: once in 16 000 frames without one"
    )
    nuisance_rounds: int = number(
        12, "most rounds of solving nuisances and contact in turn: three suffice, or ten if hard to separate"
    )
    settled: float = number(0.3, "standard deviations of a change below which sizes of nuisances have settled")
    first_change: float = number(
        0.5, "change of a nuisance, in standard deviations beside the contact, from which a first round takes it over"
    )
    outermost: float = number(
        0.15, "scattered taxels within this fraction of the array's extent from its edge are outermost"
    )
    groups: int = number(3, "most groups of taxels with an offset of their own; they are found one after another")
    per_nuisance: float = number(3.0, "gain that each nuisance needs, and that a sign other than push needs")
    largest_nuisance: float = number(
        0.4, "largest nuisance over the largest reading of its kind without it: sensors are zeroed"
    )
    drift: float = number(
        0.05,
        "standard deviation of an offset that arose after the zero, over the largest reading of its kind without it",
    )
    smallest_nuisance: float = number(
        0.01,
        "smallest nuisance to seek, over the largest reading: clean frames seem to have some of up to 0.007, and seeking them takes a tenth of the time",
    )
    structured: float = number(
        0.1, "try contact that pushes and pulls if the residual of one sign is above this fraction of the readings"
    )
    structured_chance: float = number(1e-4, "and if noise leaves as regular a residual with less than this probability")
    everywhere: float = number(
        0.6,
        "if channels cannot separate pressure from shear, reject pressure on more than this fraction of the surface if its residual is more than `structured`",
    )
    hopeless: float = number(0.5, "skip a sign of contact that gains less than this fraction of what the other gains")
    many_taxels: int = number(
        400,
        "an array of this many taxels is large: leave out several outliers at once, and seek no offsets of groups, which took a third of the time of a frame of 32 x 32 x 3",
    )
    bends: float = number(
        0.6,
        "contact without offsets may overfit if it leaves fewer degrees of freedom than this fraction of the readings: pushes that absorbed an offset of 1 to 10 % left 0.30 to 0.55, wide balls without an offset 0.69 and more",
    )
    same: float = number(0.1, "sizes of nuisances that differ by less than this fraction count as equal")
    least_weight: float = number(0.05, "of two averaged explanations, drop one with less weight than this")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Limits of the fit test, and what a misfit adds to the errors."""

    accepted: float = number(
        0.05,
        "misfit probability that a replacement needs, and below which the model of the pad is doubted: one good frame in twenty is below it",
    )
    doubted: float = number(
        0.1, "below this misfit probability (one good frame in ten), average with a rival, weighted by odds"
    )
    shows: float = number(
        4.0, "log likelihood ratio from which a residual is proportional to the readings: one clean frame in 400"
    )
    told: float = number(
        2e-5, "drop a drift if contact explains all but this fraction of its square: the residual does not show it"
    )
    loud: int = number(
        1000, "with more readings, allow drifts up to `inverse.fit.MODEL_DETAIL` of the largest: they are no misfit"
    )
    prior_weight: float = number(4.0, "readings for which the prior of the discrepancy, or of a given noise, counts")
    shares: tuple[float, ...] = number(
        (0.02, 0.05, 0.1, 0.2, 0.3), "discrepancies to try in this order, as fractions of the readings"
    )
    margin: float = number(
        0.9, "after a contact that does not fit, skip discrepancies below this times the one that its residual needs"
    )
    proves: float = number(
        10.0,
        "degrees of freedom that a contact must leave, with few readings, for its fit to prove it: with fewer, finer models, or contact and offsets together, fit the errors of a pad",
    )
    faint: float = number(
        3.0, "skip solving without discrepancy if the smallest is more than this many times the noise of the zero"
    )


@dataclass(frozen=True, kw_only=True)
class Screening:
    """Limits for broken readings, saturation and outliers."""

    moved: float = number(
        3.0,
        "standard deviations from the zero at which a channel whose readings are all the same is at the end of its range; noise does not move all of them by as much",
    )
    deviations: float = number(
        6.0, "residual from which a reading is an outlier, in standard deviations: 2e-9 of Gaussian noise", tried=True
    )
    gross: float = number(
        0.05, "and as a fraction of the largest prediction: uniform cells alone cause errors of a per cent", tried=True
    )
    examined: float = number(
        0.5, "examine residuals from this fraction of the limit, because an outlier inflates the noise that judges it"
    )
    beside_largest: float = number(
        0.5, "on large arrays, leave out several outliers at once: those above this fraction of the largest"
    )
    broken: float = number(8.0, "log evidence for leaving out one of n readings, beyond log n: odds of 3000 to one")
    most: float = number(0.2, "largest fraction of the readings to leave out: beyond it the contact is wrong")
    first_noise: float = number(
        0.3, "largest noise to try, as a fraction of the readings: go down to the first that equals its residual"
    )
    rounds: int = number(10, "most rounds of this search")
    at_end: int = number(2, "this many readings at an end of a channel's values, side by side, are saturated")
    at_end_rounded: int = number(4, "the same for rounded readings, whose peaks may have equal values")
    steps: int = number(4096, "readings count as rounded if the largest is at most this many steps: 12 bits")
    rounded_from: int = number(8, "do not look for rounding among fewer readings of a channel than this")
    near_zero: float = number(
        0.05,
        "equal readings within this fraction of the largest from zero, or beyond zero, are of taxels that nothing presses",
    )
    dead: float = number(0.1, "a zero reading is dead if its neighbours' mean is above this fraction of the largest")
    neighbours: int = number(3, "this many adjacent outliers that exceed the prediction in one direction are contact")
    candidates: int = number(4, "residuals examined in each round, largest first; the largest reading is examined too")
    fewest: int = number(6, "do not look for broken readings, or for symmetry, among fewer readings than this")
    nearly: float = number(
        1.5, "a reading is not broken if a load above its taxel leaves less than this times what removing it leaves"
    )
    explained: float = number(
        0.7, "and if that load lowers the squared residual by this fraction of what removing the reading does"
    )
    outermost: float = number(
        8.0, "an outermost taxel is broken only if it reads this many times the largest inner one"
    )
    outermost_alone: float = number(
        5.0,
        "or, on a large array and not shallow, if its residual exceeds those of its neighbours by this factor: a load beyond the edge gives them a quarter of it",
    )
    alone: float = number(4.0, "a reading this many times all others may be broken, whatever a linear model says")
    shallow: float = number(0.6, "taxels of less depth than this, in pitches, hardly feel loads on their neighbours")
    open_end: float = number(
        0.15,
        "if this fraction of a channel is saturated, the load has no upper bound; below it the intervals of 16 of 16 balls were right",
    )
    excess: float = number(
        0.25,
        "this over `STATED` is the relative standard deviation of the excess of saturated readings: two double them",
    )


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Limits for learning the noise from the frame."""

    fewest: int = number(3, "readings that a channel needs for its own noise; a constant channel of more is broken")
    unequal: float = number(
        0.2,
        "log of a channel's noise over the common noise, from which it gets its own level",
        tried=True,
        needs="channels",
    )
    unequal_errors: float = number(
        3.0, "plus this many standard errors: once in 400 channels with equal noise", needs="channels"
    )
    again: float = number(1.2, "estimate the noise again if it changes by more than this factor", tried=True)
    by_cells: float = number(
        3.0,
        "on large arrays the given noise is tried first if coarse cells leave less than this times it: fine ones follow more",
    )
    followed: float = number(
        0.05, "the linear model fits noise if its noise is less than this fraction of the contact's residual"
    )
    turns: int = number(4, "rounds of contact and noise in turn, for noise of each channel or given up to a factor")
    turns_of_all: int = number(2, "the same for one noise level of all channels")
    offset_rounds: int = number(
        2, "rounds after which offsets move only if off by `explanations.nuisance` standard deviations"
    )
    step: float = number(0.3, "rounding is noise if its standard deviation is above this fraction of the given noise")
    attempts: int = number(10, "most rounds of all these steps together")


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Penalties, and the models that are weighted."""

    shear: float = number(
        0.7, "assumed ratio of shear to pressure if friction is unknown: about rubber's", tried=True, needs="shear"
    )
    most_friction: float = number(
        1.0, "limit of friction in half of the models, if unknown and channels cannot tell shear from pressure"
    )
    even: float = number(
        1.0 / 3.0,
        "weight of the even penalty; local weights have the rest, because neither is known to be better",
        tried=True,
    )
    improbable: float = number(
        0.01, "a penalty whose odds to the best are below this is not solved: its weight would be below a hundredth"
    )
    least_weight: float = number(
        1e-3, "drop models of less weight: they move the mean by a thousandth of their difference"
    )
    reach: float = number(1.0 / 3.0, "width of the wide local mean of squared gradients, in depths", tried=True)
    floor: float = number(
        1e-6, "smallest over largest local scale: it limits the condition number in double precision", tried=True
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
        "weight of models that end at the surface's edge, if contact crosses it: objectives differ by a nat or less",
        tried=True,
    )
    slides: float = number(0.03, "a way of sliding of less probability is not solved", tried=True, needs="friction")
    jointly: int = number(
        4, "rounds of estimating the pressure, and the ratio of shear to it, in turn", tried=True, needs="friction"
    )
    sliding_unknowns: int = number(
        450, "most unknowns in all when a large contact is joined into blocks to test for sliding", needs="friction"
    )


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Sizes of cells."""

    line: tuple[int, int] = number((5, 3), "fine cells per surface cell on a line, from low to high noise")
    area: tuple[int, int, int] = number((3, 2, 1), "the same per axis on an area")
    spacing: float = number(
        1.75, "use finer cells below this number of taxels per axis and degree of freedom", tried=True
    )
    fine_spacing: float = number(
        1.2,
        "the same for the finest cells on an area if shear is sought too: with 1.75 its error was 1.005 times as large; that of pressure alone is 0.98 times as large",
    )
    unknowns: int = number(4000, "most unknowns for finer cells: a factorisation of 4000 takes a second")
    unknowns_per_reading: float = number(
        12.0, "and per reading: with 24, 86 frames took 1.4 times as long, and their error was 0.999 times as large"
    )
    few_unknowns: int = number(
        1500,
        "the limit per reading is not applied below this number of unknowns; above it, the finest cells on an area are for pressure alone: with shear beside it, balls of six pitches on 20 x 20 x 3 markers took five times as long, and the error was 0.04 instead of 0.025",
    )


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Limits that decide which cells are in contact."""

    faint: float = number(
        0.05, "cells below this fraction of the peak pressure are not contact; a tracker's error bars depend on it"
    )
    margin: int = number(2, "number of cells around a contact that are solved with it, except by the adaptive method")
    trim: float = number(
        2.5,
        "fraction of the peak below which pressure is noise, times the largest reading in units of the noise: 1.2 % of Gaussian noise exceeds it",
        tried=True,
    )
    quiet: float = number(
        1e-3, "cells below this fraction of the largest local scale and of the peak are outside the contact", tried=True
    )
    noisy: float = number(
        0.3, "for noisy frames: that fraction of the peak, times the largest reading in units of the noise", tried=True
    )
    most_quiet: float = number(0.03, "upper limit of that fraction: less than `faint`")
    at_edge: float = number(
        0.3, "if traction at the outermost taxels is above this fraction of the largest, contact may go on beyond"
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
    taxels: tuple[float, float] = number(
        (3.0, 6.0), "a contact is small if pressure above half its peak covers at most this many taxels (line, area)"
    )
    drawn: int = number(8, "discs that become models")
    least: float = number(
        0.02, "discs of less total weight are not solved: 40 of 60 ordinary frames have none, 16 have only discs"
    )
    most: float = number(0.67, "largest total weight of discs: other shapes are always possible")
    cells: int = number(4000, "with more cells than this, discs are not tried")
    places: int = number(200, "number of places, the best for the third radius, at which all radii are tried")
    best: int = number(24, "number of best discs around which places between cells are tried")
    steps: int = number(3, "interpolation steps per cell on either side")
    halvings: int = number(5, "number of times the search for the best place of each radius halves its step")
    aside: int = number(2, "steps to either side that are weighted: four taxels tell a place to 1/50 of a cell")
    few: int = number(6, "most cells of a contact in a few cells")
    scales: int = number(20, "rounds for the scale of Student's distribution: it converges in ten")


@dataclass(frozen=True, kw_only=True)
class Rims:
    """Limits for pull around a contact."""

    sought: float = number(
        0.2, "misfit probability to try a rim if noise was not given: it may have been learned from the pull"
    )
    margin: float = number(0.5, "largest width of a rim as a fraction of the contact's radius, plus one cell")
    unknowns: int = number(1500, "most unknowns of a contact with a rim: without bounds all of them are solved for")
    cancel: float = number(
        3.0, "reject a rim whose traction exceeds the push's by this factor: pushes and pulls cancel in the readings"
    )


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Error contributions other than noise, and limits for notes."""

    force: float = number(5e-4, "smallest relative error of the net force: pad and grid are not more accurate")
    force_at_size: float = number(
        4e-3, "the same for contacts too large for matrices: balls on 64 x 64 and 128 x 128 taxels were 0.2 % off"
    )
    sums_at_size: float = number(
        1.25, "factor on their standard deviations of force, moment and centre: errors in 12 frames were 1.2 of them"
    )
    felt: float = number(1.0, "a load between shallow taxels may change each reading by this many times the noise")
    gap_cells: int = number(400, "most cells of a contact in whose gaps such load is sought")
    beyond: float = number(
        0.5,
        "fraction of the possible load outside the outermost taxels that, divided by `STATED`, is its standard deviation in the errors of moment and centre: two of them cover all of it",
    )
    much: float = number(
        0.1, "note if this fraction of the load rests on one taxel, is outside the array, or may be drift"
    )
    hangs: float = number(
        0.4, "note if this fraction of the normal force rests on one reading: true of a fifth of clean frames"
    )
    stands_out: float = number(4.0, "standard deviations of a reading, or of a sum of squares, that is more than noise")
    beside: float = number(1.5, "taxels within this many pitches are neighbours, diagonal ones included")
    even_press: float = number(
        0.2,
        "an even press explains offsets if its residual is below this fraction of them; its components above this fraction of the largest have no bound",
    )
    hidden_lowest: float = number(
        0.5,
        "standard deviation of an offset that a contact hides, over the lowest reading: two of them are all of it",
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
        0.005, "error of the shear force over the normal force in that case: 0.1 to 0.8 % was found without shear"
    )
    ambiguous_peak: float = number(
        0.035,
        "in that case, the relative error of the peak is this times 1/a - 1/`ambiguous_shape`, half of it if friction is given; a is the effect of pressure over that of shear",
    )
    ambiguous_shape: float = number(
        0.2, "above this a, data determine the shape of pressure: peaks are 0.9 to 1 of true ones from 0.5 mm depth"
    )
    most_ambiguous: float = number(0.8, "largest relative error of the peak: surface markers show 0.1 to 0.5 of it")
    ambiguous_cells: float = number(
        2.7, "factor on this error for a single cell, because its calibration constants are smaller by this factor"
    )


@dataclass(frozen=True, kw_only=True)
class Work:
    """Problem sizes at which the method switches to another algorithm or leaves a step out."""

    again_unknowns: int = number(
        1000,
        "largest matrix of a model with which later frames are solved: for more unknowns, one even penalty is nearly as good, and a frame takes tens of milliseconds with friction",
    )
    again: float = number(
        1e-4,
        "relative accuracy of the models of an earlier frame in a later one: noise changes them by more, and with friction 1e-9 takes twice as long",
    )
    unknowns: int = number(9000, "most unknowns of a frame: a dense normal matrix of 650 MB")
    many_readings: int = number(
        4096,
        "with more readings, do not try the second derivative (its spectrum doubles the cost), do not test local weights (data alone show where contact is), and stop the tests of drift at the first model that passes (they take a tenth of a frame)",
    )
    likely: float = number(0.15, "start with the cells above this fraction of the linear solution's peak: saves time")
    cell_rounds: int = number(
        5,
        "rounds of adding cells: more of them follow a minimum that presses everywhere, because coarse cells leave more than noise",
    )
    missing_cells: float = number(
        0.02, "stop adding cells if the missing ones touch the others and are at most this fraction of them"
    )
    entries: int = number(
        2_000_000, "search all cells for contact in a few cells if their columns have at most this many entries"
    )
    nearest: int = number(9, "otherwise search at least this many cells nearest to the largest residual")
    finest: int = number(10_000, "most cells of half the size, which place the load within a cell, for this search")
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
