"""Numerics of problems with a friction cone: minimise a quadratic over it, its evidence and its variances. Knows no frames.

A penalised least-squares problem comes in (`model.ContactModel`), its minimum, log evidence and variances go out. Nothing here
compares explanations, reads a status or writes a note. Open `cone.py` first: the active-set method that all the rest serves.
"""
