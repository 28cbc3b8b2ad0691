"""One frame after another: what touches the pad while it happens.

In: frames of readings with their times, in order, from a prepared skin.
Out: one touch a frame in a millisecond or two, with zero, drift, failing taxels and error bars.
Open first: `tracker.py`.
"""

from palpate.tracking.health import Health
from palpate.tracking.settings import check_settings
from palpate.tracking.tracker import FRAMES_OF_ZERO, Tracker

__all__ = ["FRAMES_OF_ZERO", "Health", "Tracker", "check_settings"]
