"""Constants of the rectified method, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Policy"]


@dataclass(frozen=True)
class Policy:
    """Constants of the rectified method.

    Lengths are in pitches of the array, latent values in standard deviations of the process, log odds in nats.
    """

    #: Size of the fine cells. Where a contact ends within a cell of a pitch matters more than its shape (error on areas 0.94 -> 0.71 of the adaptive
    #: method's when halved from 1/2 to 1/4).
    cell: float = 0.25
    #: Most fine cells: a frame's time grows with their square.
    most_cells: int = 6000
    #: Most taxels of an area: no population of larger ones has calibrated the error bars.
    most_taxels: int = 144
    #: Most readings: a frame's time grows with their square times the cells.
    most_readings: int = 1000
    #: Surface cells beyond the surface on each side, on a line, where contact may go on.
    margin: int = 4
    #: Correlation lengths that compete by evidence.
    lengths: tuple[float, ...] = (0.4, 0.8, 1.6, 3.2)
    #: The one that every explanation is tried with first.
    first_length: int = 2
    #: Mean of the latent field: one cell in fifteen is in contact before anything is measured.
    mean: float = -1.5
    #: How much it falls for each pitch beyond the outermost taxels, where nothing contradicts contact, over 1.5 pitches at most.
    fall: float = 3.0
    #: The rectifier is rounded over so much on either side of zero, for Newton's method.
    rounding: float = 0.2
    #: Largest coefficient of friction where none is given: rubber on dry surfaces.
    friction: float = 1.2
    #: Standard deviation of the direction field: common to all cells, and of each place.
    shear_common: float = 1.5
    shear_local: float = 0.7
    #: Noise that nobody gave, as a part of the largest reading: median, and standard deviation of its logarithm; of channels among themselves.
    noise: float = 0.01
    noise_spread: float = 1.5
    channel_spread: float = 0.7
    #: Standard deviation of the logarithm of the amplitude.
    amplitude_spread: float = 2.0
    #: Standard deviation of an offset, in parts of the largest reading.
    offset: float = 0.3
    #: Standard deviation of a broken reading, in parts of the largest reading.
    broken: float = 3.0
    #: Log odds of an offset, a pull, no contact, one broken reading, and a discrepancy beside given noise.
    odds_offset: float = -1.5
    odds_pull: float = -2.0
    odds_none: float = 2.1
    odds_broken: float = -4.6
    odds_discrepancy: float = -3.0
    #: Share of the readings that a pad's model leaves: median of its prior, and standard deviation of its logarithm.
    discrepancy: float = 0.05
    discrepancy_spread: float = 0.7
    #: Explanations so many nats below the best one are dropped.
    dropped: float = 8.0
    #: Newton steps, and the change of the log posterior at which they end [nats].
    steps: int = 40
    tolerance: float = 0.2
    #: Explanations at the first length that go on to the others, and how many nats below the best one they may be.
    heads: int = 3
    below: float = 12.0
    #: Gain of a broken reading that the linear model proposes, and that contact must show [nats].
    proposed: float = 3.0
    shown: float = 1.0
    #: Part of the largest weight on coarse cells from which on an explanation is solved on fine ones; a frame that is empty on coarse cells is not solved again.
    worth: float = 0.03
    nothing: float = 0.99
    #: Start from the linear model: its field less this part of its largest value, of so many times its amplitude (a field of mean -1.5 is rarely positive).
    cut: float = 0.1
    louder: float = 3.0
    #: How much the amplitude grows from one length to twice it, and from half of one: 2 to 3.3 and 1.8 were seen.
    longer: float = 2.5
    shorter: float = 1.7
    #: Samples of the process that measure what coarse cells do to readings.
    samples: int = 12
