"""Linear methods at sizes that no dense decomposition serves: products by FFT, preconditioned conjugate gradients, sampled error bars.

`path` says which sizes come here; `normal` is the system (A W A^T + lambda N) u = y with t = W A^T u, `cosines` its approximation in closed
form, which preconditions it, `iteration` solves, `rules` chooses lambda, `posterior` says how sure the estimate is, and `solver` is the method.
"""
