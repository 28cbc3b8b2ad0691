"""Recordings of any length: read, reconstructed over processes or a cluster, and written, piece by piece."""

from palpate.archives.run import Reconstructed, piece_length, reconstruct_recording, worker_count

__all__ = ["Reconstructed", "piece_length", "reconstruct_recording", "worker_count"]
