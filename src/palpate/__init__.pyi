"""Public names of palpate and the rooms that define them: the only list. `__init__.py` reads it and loads a name on first use."""

from . import comparison as comparison, paper as paper, solutions as solutions
from .archives import reconstruct_recording as reconstruct_recording
from .elastic import (
    AREA_CHANNELS as AREA_CHANNELS,
    LINE_CHANNELS as LINE_CHANNELS,
    BondedLayers as BondedLayers,
    HalfSpace as HalfSpace,
    Layer as Layer,
    Viscoelastic as Viscoelastic,
    stress_from_strains as stress_from_strains,
)
from .errors import (
    InvalidInput as InvalidInput,
    NotObservable as NotObservable,
    PalpateError as PalpateError,
    Unsupported as Unsupported,
)
from .grasp import GraspMonitor as GraspMonitor
from .inverse import (
    Adaptive as Adaptive,
    Automatic as Automatic,
    Constrained as Constrained,
    Hilgers as Hilgers,
    Local as Local,
    Method as Method,
    Tikhonov as Tikhonov,
    Truncated as Truncated,
    Wiener as Wiener,
    methods as methods,
    register as register,
)
from .measured import Measured as Measured
from .recordings import Recording as Recording
from .sensing import (
    AreaArray as AreaArray,
    AreaGrid as AreaGrid,
    LineArray as LineArray,
    LineGrid as LineGrid,
    ScatteredArray as ScatteredArray,
    Uncertainty as Uncertainty,
)
from .skin import Skin as Skin
from .solid import SolidPad as SolidPad
from .status import Status as Status
from .touch import Touch as Touch
from .tracking import Tracker as Tracker

__version__: str
