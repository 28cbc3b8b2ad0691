"""Reconstruct recordings of any length, piece by piece, over processes or a cluster.

In: a recording (file or object), a skin and the options of `Skin.reconstruct`.
Out: a touch in memory, or a file of touches that an interrupted run can resume.
Open first: `run.py`.
"""

from palpate.archives.run import Reconstructed, piece_length, reconstruct_recording, worker_count

__all__ = ["Reconstructed", "piece_length", "reconstruct_recording", "worker_count"]
