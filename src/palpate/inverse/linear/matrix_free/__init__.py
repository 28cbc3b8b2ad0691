"""Linear methods for sizes at which a dense decomposition is too large: products by FFT, preconditioned conjugate
gradients, sampled error bars.

`path` decides when these are used. `normal` is the system (A W A^T + lambda N) u = y with t = W A^T u; `lattice` is
its approximation in closed form, used as preconditioner; `iteration` solves; `rules` chooses lambda; `posterior`
computes error bars; `solver` is the method.
"""
