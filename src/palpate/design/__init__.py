"""What a skin can resolve at best: bounds from its own operator, sweeps over designs, placement of taxels."""

from palpate.design.bounds import Bound
from palpate.design.detection import Noticed
from palpate.design.press import Press
from palpate.design.result import Design, evaluate

__all__ = ["Bound", "Design", "Noticed", "Press", "evaluate"]
