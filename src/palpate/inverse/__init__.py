"""From readings to traction: methods and their needs.

In: readings and a `Problem` (operator, surface, noise); a `Method` with its options, such as friction.
Out: an `Estimate`: traction, errors, status and notes of each frame.
Open first: `method.py`.
"""

from palpate.inverse.comparison.elastic_net import ElasticNet
from palpate.inverse.comparison.maximum_entropy import MaximumEntropy
from palpate.inverse.comparison.network import AnalogNetwork
from palpate.inverse.comparison.non_negative import NonNegative
from palpate.inverse.comparison.total_variation import TotalVariation
from palpate.inverse.constrained.cone import Cone, Solution, minimise
from palpate.inverse.contact.constrained import ConstrainedEstimator
from palpate.inverse.contact.methods import Adaptive, Automatic, Constrained, Local
from palpate.inverse.contact.trace import Trace, Tried, traced
from palpate.inverse.estimate import Errors, Estimate, Stated
from palpate.inverse.linear.methods import Hilgers, Tikhonov, Truncated, Wiener
from palpate.inverse.linear.parameter import RULES, choose_parameter
from palpate.inverse.linear.priors import DifferencePrior, Prior, SpectralPrior, hilgers_prior
from palpate.inverse.linear.regularised import Regularised, decompose
from palpate.inverse.method import Method, Needs, Option, Prepared
from palpate.inverse.observability import Observability, observability, observable_components
from palpate.inverse.paper.constant_friction import ConstantFriction, ConstantFrictionEstimator
from palpate.inverse.paper.division import Division, DivisionEstimator
from palpate.inverse.paper.linear_system import LinearSystem, LinearSystemEstimator
from palpate.inverse.problem import Problem
from palpate.inverse.registry import method_named, methods, register

__all__ = [
    "RULES",
    "Adaptive",
    "AnalogNetwork",
    "Automatic",
    "Cone",
    "ConstantFriction",
    "ConstantFrictionEstimator",
    "Constrained",
    "ConstrainedEstimator",
    "DifferencePrior",
    "Division",
    "DivisionEstimator",
    "ElasticNet",
    "Errors",
    "Estimate",
    "Hilgers",
    "LinearSystem",
    "LinearSystemEstimator",
    "Local",
    "MaximumEntropy",
    "Method",
    "Needs",
    "NonNegative",
    "Observability",
    "Option",
    "Prepared",
    "Prior",
    "Problem",
    "Regularised",
    "Solution",
    "SpectralPrior",
    "Stated",
    "Tikhonov",
    "TotalVariation",
    "Trace",
    "Tried",
    "Truncated",
    "Wiener",
    "choose_parameter",
    "decompose",
    "hilgers_prior",
    "method_named",
    "methods",
    "minimise",
    "observability",
    "observable_components",
    "register",
    "traced",
]
