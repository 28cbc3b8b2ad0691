"""From readings to traction: direct division, regularised inversion, and what can be observed at all."""

from palpate.inverse.account import Errors
from palpate.inverse.adaptive import Adaptive
from palpate.inverse.cone import Cone, Solution, minimise
from palpate.inverse.constant_friction import ConstantFriction
from palpate.inverse.constrained import Constrained
from palpate.inverse.direct import Division, LinearSolve
from palpate.inverse.observability import Observability, observability, observable_components
from palpate.inverse.parameter import RULES, choose_parameter
from palpate.inverse.priors import DifferencePrior, Prior, SpectralPrior, hilgers_prior
from palpate.inverse.regularised import Estimate, Regularised

__all__ = [
    "RULES",
    "Adaptive",
    "Cone",
    "ConstantFriction",
    "Constrained",
    "DifferencePrior",
    "Division",
    "Errors",
    "Estimate",
    "LinearSolve",
    "Observability",
    "Prior",
    "Regularised",
    "Solution",
    "SpectralPrior",
    "choose_parameter",
    "hilgers_prior",
    "minimise",
    "observability",
    "observable_components",
]
