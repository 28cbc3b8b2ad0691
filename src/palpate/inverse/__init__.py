"""From readings to traction: direct division, regularised inversion, and what can be observed at all."""

from palpate.inverse.constant_friction import ConstantFriction
from palpate.inverse.direct import Division, LinearSolve
from palpate.inverse.observability import Observability, observability, observable_components
from palpate.inverse.parameter import RULES, choose_parameter
from palpate.inverse.priors import DifferencePrior, Prior, SpectralPrior, hilgers_prior
from palpate.inverse.regularised import Estimate, Regularised

__all__ = [
    "RULES",
    "ConstantFriction",
    "DifferencePrior",
    "Division",
    "Estimate",
    "LinearSolve",
    "Observability",
    "Prior",
    "Regularised",
    "SpectralPrior",
    "choose_parameter",
    "hilgers_prior",
    "observability",
    "observable_components",
]
