"""What the automatic method is made of: parts that can be left out, and the numbers that they go by.

`palpate bench ablation` leaves out each part, and halves and doubles the numbers that no derivation gives, on contacts that tuned none of
them ("see the table" below means its table). Users choose a method, not these.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["STATED", "Parts", "Thresholds"]


#: The constants of the error bars of force and traction multiply the model's standard deviations by this at least (tests/test_real_readings.py):
#: what is stated by the user or assumed is divided by it, so that no constant makes it smaller.
STATED = 0.5


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Parts of the automatic method; without one, everything else goes on.

    Attributes
    ----------
    constraint : bool
        Pressure never pulls, and shear stays within friction where that is given.
    even_model : bool
        The model of an even penalty is part of the mean.
    second_derivative : bool
        So is one that keeps the second derivative small, by its evidence.
    wide_weights, narrow_weights : bool
        So are models of penalties weighed locally, learned over a third of the depth and over a single cell.
    posterior_variance : bool
        What is not known of the gradient counts where local weights are learned.
    shear_in_contact : bool
        Without known friction, local weights leave no shear where nothing presses.
    finer_grid : bool
        Models are solved on cells finer than the surface's.
    finer_sliding : bool
        Contact that slides, which is sought as pressure alone, on finer cells still.
    wide_surface : bool
        Contact is sought beyond the edge of the surface too.
    ends_on_surface : bool
        Where contact reaches beyond the surface, some weight goes to models that end on it.
    sliding : bool
        Where friction is known, models of a contact that slides as a whole, by their evidence.
    trim : bool
        Cells whose pressure is not told from none are left out.
    channel_noise : bool
        Each channel has its own noise.
    noise_again : bool
        The noise is learned again from what contact leaves unexplained.
    uneven_evidence : bool
        What noise of different levels explains is no evidence of contact.
    explains : bool
        Models of local weights explain the readings as the others do.
    outliers : bool
        Readings that no contact explains are left out.
    pulls : bool
        A frame that pushing does not explain is given to the linear method (where friction is not known).
    rims : bool
        Pull about a contact is sought where a push leaves more than noise.
    common_shear : bool
        Shear in one proportion to the pressure, which penalties shrink, is added to every model (where friction is not known).
    screening : bool
        Broken readings are left out before contact is sought, and readings at a ceiling count as "at least".
    nuisances : bool
        Offsets of the readings are sought.
    narrowed : bool
        With friction, cells that will be trimmed are left out before: what is left may be solved on finer cells.
    sharp : bool
        Contact much smaller than a pitch, which the linear model takes for noise, is sought in a few cells.
    compact : bool
        A contact of a few taxels may be a disc of any place and radius: shallow taxels do not tell.
    skipped : bool
        What saves time: improbable models have no local weights.
    """

    constraint: bool = True
    even_model: bool = True
    second_derivative: bool = True
    wide_weights: bool = True
    narrow_weights: bool = True
    posterior_variance: bool = True
    shear_in_contact: bool = True
    finer_grid: bool = True
    finer_sliding: bool = True
    wide_surface: bool = True
    ends_on_surface: bool = True
    sliding: bool = True
    trim: bool = True
    channel_noise: bool = True
    noise_again: bool = True
    uneven_evidence: bool = True
    explains: bool = True
    outliers: bool = True
    pulls: bool = True
    rims: bool = True
    common_shear: bool = True
    screening: bool = True
    nuisances: bool = True
    narrowed: bool = True
    sharp: bool = True
    compact: bool = True
    skipped: bool = True


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Numbers that the automatic method goes by, each with where it comes from."""

    # -- is there contact

    #: Gain in log evidence over noise alone below which a frame counts as empty: odds of 400 to one. See the table,
    #: contacts missed and false alarms.
    contact: float = 6.0
    #: The same for contact in a few cells, over noise of any tail (`palpate.inverse.contact.sharp`): of 400 empty frames of areas of 3 to 8 taxels
    #: (Gaussian noise, even and not, and Student's of 2.5 degrees of freedom) the largest was 2.5.
    sharp: float = 4.0
    #: Contact that only pushes does not explain a frame if this many standard deviations of misfit remain (the root mean square of Gaussian
    #: noise over ten readings exceeds 2 once in a million frames, so that 3 is no noise) and this part of the signal (a convention).
    unexplained: float = 3.0
    unexplained_signal: float = 0.03
    #: What contact leaves is no noise if it is more than this part of all readings, where a linear model explains them: most of it, in the
    #: plain sense of the word.
    most: float = 0.5

    #: Noise of another level in each channel explains nothing where neighbours are so alike that noise is as seldom: one empty frame in a thousand.
    ordered: float = 1e-3

    # -- what a frame is taken to be (`palpate.inverse.contact.hypotheses`)

    #: Other signs and offsets are tried where contact that pushes leaves this part of the readings ...
    doubt: float = 0.15
    #: ... or where the outermost cells over the array are loaded on more than this part of its edge (one end of a line, two sides of an area):
    #: that is what contact across the edge does, and what an offset is taken for.
    edge: float = 0.4
    #: Where they are loaded nearly all round, an offset may hide even if none was found.
    ring: float = 0.7
    #: A nuisance is there if its size is this many standard deviations (once in 16,000 frames without it).
    nuisance: float = 4.0
    #: Rounds in which nuisances and contact are found in turn: they come to rest in three, in ten where they are hard to tell apart.
    nuisance_rounds: int = 12
    #: Gain that a nuisance, and that another sign than pushing, must bring to be believed.
    per_nuisance: float = 3.0
    other_sign: float = 3.0
    #: A nuisance is never larger than this part of the largest reading without it, of any channel of its kind (a convention: sensors are zeroed).
    largest_nuisance: float = 0.4
    #: One smaller than this part of it is not told from what the model cannot follow (five times `fit.MODEL_DETAIL`).
    smallest_nuisance: float = 0.01
    #: Contact that pushes and pulls at once is what a frame is taken to be where one sign leaves this part of the readings, in an order that
    #: noise has as seldom as this.
    structured: float = 0.1
    structured_chance: float = 1e-4
    #: Where the channels alone do not tell pressure from shear, neither does contact that covers this part of the surface (a convention).
    everywhere: float = 0.6
    #: Where the whole edge of the array is loaded, an offset of this part of the largest reading may hide (a convention).
    hidden_offset: float = 0.1
    #: Offsets and ramps of displacements, which wide pressure may hide, are of this part of the largest reading (standard deviation, divided by
    #: `STATED`; a convention: half of `largest_nuisance` is two deviations).
    hidden_drift: float = 0.1
    #: In readings that the model does not explain any channel may drift: by this part of the largest reading of its kind (standard deviation of offsets and
    #: of ramps at either end, divided by `STATED`; a convention: two of them are what `palpate bench trust` calls large).
    refuted_drift: float = 0.1
    #: Hypotheses whose gains differ by less than this are both followed.
    undecided: float = 10.0

    # -- which readings count, and their noise

    #: A reading is left out if it is this many robust standard deviations (2e-9 of Gaussian noise) ...
    outlier: float = 6.0
    #: ... and this part of the largest reading from what the contact explains: cells of the surface alone leave a per cent.
    gross: float = 0.05
    #: A reading is broken before any contact is sought if leaving it out gains this much evidence beyond the choice among all readings: odds
    #: of 3000 to one, as one frame in so many with a reading left out in vain is rare enough.
    broken: float = 8.0
    #: Noise that was given counts as exceeded where contact leaves this part of the readings (and `unexplained` times the noise).
    exceeded: float = 0.03
    #: Readings at the end of their range may be larger by this part (standard deviation, divided by `STATED`): 2 deviations double them.
    excess: float = 0.25
    #: Readings that no contact explains are left out up to this part of all: beyond it the contact is what is wrong (a
    #: convention).
    most_outliers: float = 0.2
    #: Channels have each their own noise where their misfits differ by more than this (log; see the table) ...
    unequal: float = 0.2
    #: ... and by so many standard errors (once in 400 frames where they are alike).
    unequal_errors: float = 3.0
    #: The noise is learned again where the constrained misfit is this many times what the linear model called noise: see the table.
    quieter: float = 1.2
    #: A linear model that calls less than this part of what contact leaves noise follows noise too: 1e-6 where it can, with displacements along
    #: all axes of shallow markers; 0.3 at least on the accuracy benchmark.
    followed: float = 0.05

    # -- prior

    #: Shear over pressure where friction is not known: of the order of rubber's friction.
    shear: float = 0.7
    #: Friction that is not known is rarely more (rubber on rough surfaces). Only where the channels alone do not tell pressure from shear.
    most_friction: float = 1.0
    #: Share of the models of an even penalty in the mean; the rest goes to local weights in equal parts. One in three, as none is known
    #: to be better; half where the second derivative is what a frame speaks for. See the table.
    even: float = 1.0 / 3.0
    #: Models less probable than this against the best are not solved: they would have less than a hundredth of the weight.
    improbable: float = 0.01
    #: Reach of the wide local weights in depths; see the table.
    reach: float = 1.0 / 3.0
    #: Smallest local scale, as a part of the largest: keeps the problem's condition within double precision; the answer does not
    #: depend on it (see the table).
    floor: float = 1e-6
    #: Local weights are relearned this many times (majorisation: each lowers the objective); more change nothing (see the table).
    rounds: int = 4

    # -- grid

    #: Cells finer than the surface's by five rather than three (line), two rather than one (area) where a degree of freedom of the data
    #: stands for fewer taxels per axis than this; three on an area below the second. At one, the data tell every taxel's cell; see
    #: the table.
    spacing: float = 1.75
    fine_spacing: float = 1.2
    #: Unknowns of one frame up to which finer cells are used: a Cholesky factorisation of 4000 takes a second on one core.
    unknowns: int = 4000
    #: ... and up to so many for each reading, where these are more than a second number of unknowns. The finer the cells and the smaller the noise, the
    #: worse is the condition: with 34 unknowns a reading a frame of 6 x 6 x 3 took 1.4 to 13 s, with 15 it takes 0.3 s, and the errors are no larger.
    unknowns_per_reading: float = 24.0
    few_unknowns: int = 1500

    # -- where contact is

    #: Pressure below this many times noise over signal, as a part of the peak, is noise (1.2 % of Gaussian noise lies beyond) ...
    trim: float = 2.5
    #: ... but never more than this part of the peak, the same as `constrained.FAINT`.
    largest_trim: float = 0.05
    #: Cells below this part of the largest local scale, and of the peak pressure, are outside the contact ...
    quiet: float = 1e-3
    #: ... more where there is more noise: so many times noise over signal (see the table) ...
    noisy: float = 0.3
    #: ... up to this part (a convention: below `largest_trim`).
    most_quiet: float = 0.03
    #: Weight of a contact that ends on the surface against one that reaches twice as far, where the frame could be either (the
    #: objectives differ by a nat or less). See the table.
    ends: float = 0.2

    # -- sliding

    #: Sliding less probable than this is not followed up, nor is shear of its own: see the table.
    slides: float = 0.03
    #: Rounds in which shear over pressure and the pressure are found in turn: more change nothing (see the table).
    jointly: int = 4
