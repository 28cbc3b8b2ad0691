"""All numbers and switches of the contact method, each with its reason, in one tree.

A function that decides something takes a `Policy` (or an estimator with a ``policy``) and reads the number from it; no
other file of `inverse/contact` holds one. `palpate bench ablation` walks the fields: it switches off each part, and
halves and doubles the numbers marked ``tried``, on contacts that were not used to tune them ("see the table" refers to
its table). Users choose a method, not these numbers. `numbers` lists them all.
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

    evidence: float = number(6.0, "log evidence over noise alone: odds of 400 to one", tried=True)
    few_cells: float = number(
        4.0, "the same of a few cells over noise of any tail: the largest of 400 empty frames was 2.5"
    )
    patch: float = number(
        15.0, "log evidence of a patch beside a larger one: `evidence`, log of a thousand places, 2 to spare"
    )
    unexplained: float = number(
        3.0, "deviations of misfit that a push may leave: ten readings have 2 once in a million frames"
    )
    unexplained_signal: float = number(0.03, "and this part of the signal, a convention")
    most_left: float = number(0.5, "a contact that leaves most of the readings tells nothing of them")
    student: float = number(
        2.0, "degrees of freedom of Student's distribution: as heavy as noise that still has a scale"
    )
    stands_out: float = number(
        6.0, "a small contact makes a reading so many times half of its channel: 4 Gaussian deviations"
    )
    short_line: int = number(25, "on so few taxels of a line contact may be all that it reads")
    short_line_noise: float = number(0.03, "there noise begins at this part of the readings")
    short_line_left: float = number(0.35, "and contact explains them where it leaves this part")
    few_readings: int = number(
        50, "noise learned from so few readings proves nothing; finer models follow the pad's errors (four real skins)"
    )


@dataclass(frozen=True, kw_only=True)
class Explanations:
    """Limits for choosing an explanation: push, pull or both; with or without offsets and ramps; and for replacing one
    that fits poorly.
    """

    doubt: float = number(0.15, "a pull is tried where a push leaves this part of the readings")
    edge: float = number(
        0.4,
        "where the cells over the outermost taxels are loaded on this part (one end of a line, two sides of an area), a level may be theirs",
    )
    ring: float = number(0.7, "loaded nearly all round, an offset may hide even if none was found")
    nuisance: float = number(4.0, "deviations at which a nuisance is there: once in 16 000 frames without it")
    nuisance_rounds: int = number(
        12, "rounds of nuisances and contact in turn: they settle in three, in ten where hard to tell apart"
    )
    groups: int = number(3, "groups of taxels with an offset of their own, one after another")
    per_nuisance: float = number(3.0, "gain that each nuisance, or another sign than pushing, must bring")
    largest_nuisance: float = number(
        0.4, "part of the largest reading of its kind that one is at most: sensors are zeroed"
    )
    smallest_nuisance: float = number(
        0.01, "a smaller part is what the model cannot follow: five times `fit.MODEL_DETAIL`"
    )
    structured: float = number(0.1, "contact pushes and pulls at once where one sign leaves this part of the readings")
    structured_chance: float = number(1e-4, "in an order that noise has as seldom as this")
    everywhere: float = number(
        0.6, "pressure that channels do not tell from shear is none where it covers this part of the surface"
    )
    half: float = number(
        0.5, "what is half as large as what counts is looked at closely: an outlier raises the noise that judges it"
    )
    many_taxels: int = number(
        400, "so many taxels tell an offset too small to be sought: the search took a third of a frame of 32 x 32 x 3"
    )
    bends: float = number(
        0.6,
        "a push that leaves less than this part of the readings free bends to them: pushes that took up an offset of 1 to 10 % left 0.30 to 0.55, wide balls without one 0.69 and more",
    )
    same: float = number(0.1, "sizes of nuisances that differ by less than this part are the same")
    followed: int = number(2, "so many rivals take the place of an explanation that is refuted")
    least_weight: float = number(0.05, "of two weighed explanations one with less is left out")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Limits of the fit test, and what a misfit adds to the errors."""

    accepted: float = number(
        0.05, "one that takes another's place explains the frame as well as one good frame in twenty"
    )
    doubted: float = number(0.1, "below it, one good frame in ten, a rival that gained nearly as much is weighed too")
    shows: float = number(
        4.0, "log likelihood at which a part of the residual in proportion to the readings shows: a clean frame in 400"
    )
    told: float = number(
        1e-6, "contact takes up a direction but for this part of its square: it tells nothing of drift"
    )
    told_at_size: float = number(2e-5, "the same of contacts whose solutions are known to less")
    many: int = number(
        4096, "of more readings each model's test takes a tenth of a frame: stop at the first that passes"
    )
    loud: int = number(1000, "more readings tell drifts as small as `fit.MODEL_DETAIL`, which are no misfit")
    prior_weight: float = number(4.0, "readings that the prior of the discrepancy counts for")
    shares: tuple[float, ...] = number((0.02, 0.05, 0.1, 0.2, 0.3), "discrepancies that are tried in turn")
    faint: float = number(3.0, "noise of a zero so many times below the least discrepancy is not tried by itself")


@dataclass(frozen=True, kw_only=True)
class Screening:
    """Limits for broken readings, saturation and outliers."""

    deviations: float = number(
        6.0, "robust deviations at which a reading is no noise: 2e-9 of Gaussian noise", tried=True
    )
    gross: float = number(
        0.05, "part of the largest reading that contact must miss it by: cells alone leave a per cent", tried=True
    )
    broken: float = number(8.0, "log evidence beyond the choice among all for one left out: odds of 3000 to one")
    most: float = number(0.2, "part of the readings that is left out at most: beyond it the contact is wrong")
    first_noise: float = number(
        0.3, "part of the readings from which noise is sought downwards: the largest that explains itself"
    )
    rounds: int = number(10, "rounds of it")
    at_end: int = number(2, "neighbours that read the same largest value lie at an end of their range")
    at_end_rounded: int = number(4, "of rounded readings, whose peaks share values")
    steps: int = number(4096, "readings count as rounded where the largest is so many steps: 12 bits")
    dead: float = number(0.1, "a reading of zero is dead where its neighbours' mean is this part of the largest")
    dead_neighbours: float = number(0.25, "and at most this part of them reads zero: at a threshold half of them do")
    neighbours: int = number(3, "so many neighbours that are not explained are a contact, no broken taxels")
    candidates: int = number(4, "readings looked at closely in each round")
    fewest: int = number(6, "fewer readings are not screened")
    nearly: float = number(
        1.5,
        "a reading is not broken where a load over its taxel leaves less than this many times what leaving it out does",
    )
    explained: float = number(0.7, "and explains this part of what that does")
    outermost: float = number(8.0, "the outermost taxels are broken only where they read so many times the others")
    outermost_alone: float = number(
        5.0,
        "or where their residuals are so many times their neighbours', on a large array: a load beyond the edge gives those a quarter",
    )
    alone: float = number(4.0, "a reading so many times all others is alone, whatever a linear model makes of it")
    shallow: float = number(0.6, "taxels less deep, in pitches, feel next to nothing of what their neighbours do")
    window: tuple[int, int] = number((20, 6), "half the taxels of a window of a large array, on a line and on an area")
    window_edge: int = number(3, "nearer to a window's edge a reading is left to another window")
    suspicious: float = number(
        5.0, "robust deviations from its neighbours at which a reading of a large array is looked at"
    )
    suspicious_alone: float = number(1.5, "and times as far as those a little farther away are from theirs")
    windows: int = number(24, "windows a round, the most suspicious")
    window_rounds: int = number(3, "rounds: each finds what larger ones hid")
    open_end: float = number(
        0.15, "part of a channel at its end from which the load has no upper end: 16 of 16 balls held below it"
    )
    excess: float = number(
        0.25, "readings at their end may be larger by this part, divided by `STATED`: two deviations double them"
    )


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Limits for learning the noise from the frame."""

    fewest: int = number(3, "readings of a channel needed for a noise of its own")
    unequal: float = number(
        0.2, "log by which channels' misfits differ where each has its own noise", tried=True, needs="channels"
    )
    unequal_errors: float = number(
        3.0, "and standard errors: once in 400 frames where they are alike", needs="channels"
    )
    again: float = number(1.2, "factor by which noise must change to be learned again", tried=True)
    followed: float = number(
        0.05, "a linear model that calls less than this part of what contact leaves noise follows noise"
    )
    turns: int = number(4, "channels' noise and contact are found in turn so often")
    turns_of_all: int = number(2, "the noise of all channels together, so often")
    outlier_rounds: int = number(4, "rounds of leaving readings out: each finds what larger ones hid")
    broken_rounds: int = number(2, "the same where a channel is broken")
    offset_rounds: int = number(2, "offsets are found again with the contact, so often")
    most_offset_rounds: int = number(6, "and so often where they are far off yet")
    step: float = number(
        0.3, "deviations of given noise from which on the step that readings are rounded to is part of it"
    )
    attempts: int = number(10, "all of these together; each settles by itself")


@dataclass(frozen=True, kw_only=True)
class Prior:
    """Penalties, and the models that are weighted."""

    shear: float = number(
        0.7, "shear over pressure where friction is not known: of the order of rubber's", tried=True, needs="shear"
    )
    most_friction: float = number(
        1.0, "friction that is not known is rarely more, where channels do not tell pressure from shear"
    )
    even: float = number(
        1.0 / 3.0, "weight of the even penalty; the rest goes to local weights: none is known to be better", tried=True
    )
    improbable: float = number(
        0.01, "models less probable are not solved: they would have less than a hundredth of the weight"
    )
    least_weight: float = number(1e-3, "models of less weight move the mean by a thousandth of their difference")
    reach: float = number(1.0 / 3.0, "reach of the wide local weights in depths", tried=True)
    floor: float = number(
        1e-6, "least local scale over the largest: keeps the condition within double precision", tried=True
    )
    rounds: int = number(4, "local weights are relearned so often: each lowers the objective", tried=True)
    larger: tuple[float, ...] = number(
        (1.0, 4.0, 16.0, 64.0), "factors of local scales that keep contact from explaining the readings"
    )
    left_more: float = number(4.0, "standard deviations of what more is left by chance")
    ends: float = number(
        0.2, "weight of a contact that ends on the surface: the objectives differ by a nat or less", tried=True
    )
    slides: float = number(
        0.03, "sliding less probable is not followed up, nor is shear of its own", tried=True, needs="friction"
    )
    jointly: int = number(4, "rounds of shear over pressure and pressure in turn", tried=True, needs="friction")
    sliding_unknowns: int = number(
        450, "a large contact is looked at for sliding in blocks of so many unknowns", needs="friction"
    )


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Sizes of cells."""

    line: tuple[int, int] = number((5, 3), "fine cells per surface cell on a line, from low noise to high")
    area: tuple[int, int, int] = number((3, 2, 1), "the same per axis on an area")
    spacing: float = number(1.75, "taxels per axis and degree of freedom below which cells are finer", tried=True)
    fine_spacing: float = number(1.2, "the same of the finest cells on an area: the data tell every taxel's cell")
    unknowns: int = number(4000, "unknowns up to which finer cells are used: a factorisation of 4000 takes a second")
    unknowns_per_reading: float = number(
        24.0, "and so many for each reading: 34 took 1.4 to 13 s of a frame of 6 x 6 x 3, at the same error"
    )
    few_unknowns: int = number(1500, "where these are more than so many unknowns")


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Limits that decide which cells are in contact."""

    faint: float = number(
        0.05, "cells below this part of the peak make no contact; error bars of a tracker are calibrated with it"
    )
    margin: int = number(2, "cells so near to a contact are part of its problem")
    trim: float = number(
        2.5, "pressure below so many times noise over signal is noise: 1.2 % of Gaussian noise lies beyond", tried=True
    )
    quiet: float = number(1e-3, "cells below this part of the largest local scale and peak are outside", tried=True)
    noisy: float = number(0.3, "more where noise is more: so many times noise over signal", tried=True)
    most_quiet: float = number(0.03, "up to this part: below `faint`")
    at_edge: float = number(
        0.3, "traction at the outermost taxels, over the largest, from which contact goes on beyond them"
    )
    goes_on: float = number(0.5, "traction outside them from which it goes on there and nothing says how far")


@dataclass(frozen=True, kw_only=True)
class Discs:
    """Limits for contacts of a few taxels."""

    radii: tuple[float, ...] = number(
        (0.5, 1.0, 1.5, 2.25, 3.25, 4.5, 6.0), "in cells of the finer grid, up to a pitch"
    )
    at_end: float = number(0.8, "where more of the weight is at the largest radius, contact is larger")
    taxels: tuple[float, float] = number(
        (3.0, 6.0), "taxels pressed half as hard as the peak on which a contact is small, line and area"
    )
    drawn: int = number(8, "discs that become models")
    detail: float = number(0.015, "part of the largest reading that discs leave: their edges are not those of contact")
    least: float = number(
        0.02, "weight below which they are not worth solving: of 60 plain frames 40 have none and 16 all"
    )
    most: float = number(0.67, "weight of all at most: a disc is never all that is possible")
    worse: float = number(2.0, "discs that leave so many times the noise, and what fields leave, are none")
    cells: int = number(4000, "cells that places are sought among")
    places: int = number(200, "places that discs of the third radius do best at, where all radii are tried")
    best: int = number(24, "the best discs, about which places between cells are tried")
    steps: int = number(3, "places to a cell on either side")
    halvings: int = number(5, "halvings of the step in which the best place of each radius is sought")
    aside: int = number(2, "steps to either side that are weighed: four taxels tell a place to a fiftieth of a cell")
    few: int = number(6, "cells of a contact of a few cells: more are no longer few")
    scales: int = number(20, "rounds of the scale of Student's distribution: it settles in ten")


@dataclass(frozen=True, kw_only=True)
class Rims:
    """Limits for pull around a contact."""

    sought: float = number(
        0.2, "misfit probability below which it is sought where noise may have been learned from the pull"
    )
    evident: float = number(12.0, "gain that it needs there: rims gain 17 to 500, what is no rim 11 or less")
    margin: float = number(0.5, "of the contact's radius: a rim is narrower")
    unknowns: int = number(1500, "none of them is at a bound, so that each is solved for")
    cancel: float = number(
        3.0, "traction so many times that of the push is pushes and pulls that cancel in the readings"
    )


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Error contributions other than noise, and limits for notes."""

    force: float = number(5e-4, "least error of the net force, in parts: no pad and no grid is known better")
    force_at_size: float = number(
        4e-3, "the same of a contact too large for matrices: balls on 64 and 128 squared read 0.2 % off"
    )
    sums_at_size: float = number(1.25, "factor of their deviations: errors of 12 frames of 128 squared are 1.2 of them")
    beyond: float = number(
        0.5, "deviation of what lies beyond the outermost taxels, of what may: two of them are all of it"
    )
    much: float = number(
        0.1, "part of the load worth a word where one taxel alone tells it, it lies outside, or drift may make it"
    )
    hangs: float = number(
        0.4, "part of the normal force that one reading tells, from which it is said: a fifth of clean frames say it"
    )
    stands_out: float = number(4.0, "deviations at which a reading, or the squares of many, is no noise")
    beside: float = number(1.5, "taxels within so many pitches are neighbours, across too")
    even_press: float = number(0.2, "an even press explains offsets where it leaves less than this part of them")
    hidden_drift: float = number(
        0.1,
        "part of the largest reading of an offset that a loaded edge hides, and of drift of displacements: half of `largest_nuisance` is two deviations",
    )
    ambiguous_force: float = number(
        0.05, "of the force, where channels do not tell pressure from shear: 1.86 to 1.95 N for 2 N (in_plane.md)"
    )
    ambiguous_coupled: float = number(0.02, "the same where friction is given: errors of 1 to 3 %")
    ambiguous_shear: float = number(0.005, "of the shear force there: 0.1 to 0.8 % where nothing shears")
    ambiguous_peak: float = number(
        0.035, "of the peak, times 1/a - 1/`ambiguous_shape`, a being what pressure does over what shear does"
    )
    ambiguous_shape: float = number(
        0.2, "above it pressure has its shape: peaks of 0.9 to 1 from 0.5 mm below the surface"
    )
    most_ambiguous: float = number(0.8, "of the peak at most: 0.1 to 0.5 of it is found from markers on the surface")
    ambiguous_cells: float = number(2.7, "the same of a cell, whose constants of calibration are so many times less")


@dataclass(frozen=True, kw_only=True)
class Work:
    """Problem sizes at which the method switches to another algorithm or leaves a step out."""

    unknowns: int = number(9000, "of one frame: a dense normal matrix of 650 MB")
    second_order: int = number(
        4096, "readings up to which the second derivative is tried: its spectrum costs as much again"
    )
    hold: int = number(4096, "more readings hold contact by themselves, and where it is")
    likely: float = number(0.15, "part of the linear solution's peak at which cells start as contact: saves time")
    cell_rounds: int = number(12, "rounds of adding cells")
    few_cells: float = number(0.02, "part of the cells that are not added for their sake")
    entries: int = number(
        2_000_000, "entries of all cells' columns that are looked through for a contact of a few cells"
    )
    nearest: int = number(9, "else so many cells nearest to the largest reading at least")
    finest: int = number(10_000, "cells up to which they are twice as fine: where in a cell it lies is seen")
    blocks: int = number(32, "blocks that are multiplied at a time")
    trace: float = number(1e-6, "noise that readings without any are given, as a part of each")


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
