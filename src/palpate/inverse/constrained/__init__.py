"""Numerics of problems with a friction cone: minimum of a quadratic over the cone, its evidence and its variances.

In: a penalised least-squares problem (`model.ContactModel`). Out: its minimum, log evidence and variances. Nothing
here knows frames, statuses or notes. Open first: `cone.py`, the active-set method that everything else serves.
`compiled.py` does parts of it in C++.
"""
