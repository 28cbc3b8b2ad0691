"""The physics: pads, the states of one wavevector, and the quantities a sensor can feel. Knows no grid."""

from palpate.elastic.half_space import HalfSpace, Pad
from palpate.elastic.hooke import stress_from_strains
from palpate.elastic.layers import BondedLayers, Layer
from palpate.elastic.quantities import AREA_CHANNELS, LINE_CHANNELS, channel_unit, transfer
from palpate.elastic.viscoelastic import CreepFilter, Viscoelastic

__all__ = [
    "AREA_CHANNELS",
    "LINE_CHANNELS",
    "BondedLayers",
    "CreepFilter",
    "HalfSpace",
    "Layer",
    "Pad",
    "Viscoelastic",
    "channel_unit",
    "stress_from_strains",
    "transfer",
]
