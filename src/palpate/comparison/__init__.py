"""Methods for comparison: each solves for the whole map by the same call, and excludes pulling pressure.

In: nothing; this package has no code of its own.
Out: the five classes of `palpate.inverse.comparison`, which users import from here.
Open first: `../inverse/comparison/whole_map.py`.
"""

from palpate.inverse import AnalogNetwork, ElasticNet, MaximumEntropy, NonNegative, TotalVariation

__all__ = ["AnalogNetwork", "ElasticNet", "MaximumEntropy", "NonNegative", "TotalVariation"]
