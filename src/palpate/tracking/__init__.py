"""One frame after another: what touches the pad while it happens.

- `tracker`: the loop of one frame, and its answer;
- `times`: the frames' times, and clocks that begin anew;
- `health`: readings that are missing, out of range, stuck or unexplained, and how they are left out;
- `zero`: the baseline and its drift;
- `standing`: offsets that no zero was taken of;
- `offsets`: drift that all taxels of a channel share, told from contact;
- `learning`: the weight of the penalty and the noise;
- `contact`: what touches in a frame, and whether that explains it;
- `pulling`: traction of either sign;
- `misfit`: how probable as much misfit is;
- `region`: the cells where contact is sought, and the inverse that is kept for them;
- `gram`: their normal matrix, of which only what a contact comes to is made;
- `search`: when the region moves, and what the contact does not explain;
- `iteration`: the alternating direction method of multipliers;
- `errors`: error bars, made anew now and then;
- `rest`, `discrepancy`: what frames without contact show, and what the pad's model leaves unexplained;
- `single`: the answer compared with that of a frame by itself; `anchor`: what that found, carried along;
- `words`: what is said of a frame;
- `background`: long work beside the stream.
"""

from palpate.tracking.health import Health
from palpate.tracking.settings import check_settings
from palpate.tracking.tracker import FRAMES_OF_ZERO, Tracker

__all__ = ["FRAMES_OF_ZERO", "Health", "Tracker", "check_settings"]
