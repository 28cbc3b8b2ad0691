"""Real-time contact: solve the frames of a stream one after another.

In: frames of readings with their times, in order, from a prepared skin.
Out: one touch per frame in a millisecond or two, with zero, drift, failing taxels and error bars.
Open first: `tracker.py`.
"""

from palpate.tracking.health import Health
from palpate.tracking.settings import check_settings
from palpate.tracking.tracker import FRAMES_OF_ZERO, Tracker

__all__ = ["FRAMES_OF_ZERO", "Health", "Tracker", "check_settings"]
