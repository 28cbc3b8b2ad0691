"""The physics of a pad for one wavevector. Knows no grid.

In: moduli, layers and depth; a wavevector.
Out: a matrix from surface traction to displacement, stress and strain at a depth (`channels.py` lists what can be measured).
Open first: `pad.py`.
"""

from palpate.elastic.channels import AREA_CHANNELS, CHANNELS, LINE_CHANNELS, Channel, channel_unit, find_channel
from palpate.elastic.half_space import HalfSpace, from_radial
from palpate.elastic.hooke import stress_from_strains
from palpate.elastic.layers import BondedLayers, Layer
from palpate.elastic.pad import Pad
from palpate.elastic.quantities import transfer
from palpate.elastic.viscoelastic import CreepFilter, Viscoelastic

__all__ = [
    "AREA_CHANNELS",
    "CHANNELS",
    "LINE_CHANNELS",
    "BondedLayers",
    "Channel",
    "CreepFilter",
    "HalfSpace",
    "Layer",
    "Pad",
    "Viscoelastic",
    "channel_unit",
    "find_channel",
    "from_radial",
    "stress_from_strains",
    "transfer",
]
