"""Linear methods (`methods`): priors, and the rules that choose a parameter. `regularised` solves by a spectral
decomposition and `matrix_free` by iteration; `solution`, `patterns` and `posterior` hold what both share: notes, nuisances,
error bars.
"""
