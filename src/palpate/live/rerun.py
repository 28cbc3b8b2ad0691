"""Send a stream to Rerun: to its viewer or to a file (``pip install palpate[rerun]``)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate._arrays import to_numpy
from palpate._extras import missing
from palpate.errors import InvalidInput
from palpate.touch import Touch

if TYPE_CHECKING:
    from palpate.grasp import Event

__all__ = ["RerunSink"]

#: Largest number of shear arrows on a side of the map.
ARROWS = 24


class RerunSink:
    """Logs pressure, shear arrows, net force and events to Rerun (a sink of `Session`).

    Parameters
    ----------
    path : str or Path, optional
        File (.rrd) to write; without it the viewer is started.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        try:
            import rerun
        except ImportError as error:
            raise missing("Rerun streams", error) from error
        if path is not None and Path(path).exists():
            raise InvalidInput(f"{path} exists; a recording is not overwritten. Give another name.")
        self._rerun, self._path = rerun, path
        self._stream = rerun.RecordingStream("palpate")
        try:
            if path is None:
                self._stream.spawn()
            else:
                self._stream.save(str(path))
        except (OSError, RuntimeError) as error:
            raise InvalidInput(f"Rerun cannot be reached ({error}).") from error

    def readings(self, time: float, values: Any) -> None:
        """Log the readings of one frame (channel, *array) at ``time`` [s]; planes that differ in shape one by one."""
        self._stream.set_time("time", duration=time)
        planes = [np.asarray(v) for v in values] if isinstance(values, list | tuple) else []
        if len({p.shape[1:] for p in planes}) > 1:
            for number, plane in enumerate(planes):
                self._stream.log(f"readings/{number}", self._rerun.Tensor(plane.astype(np.float32)))
            return
        self._stream.log("readings", self._rerun.Tensor(to_numpy(values).astype(np.float32)))

    def touch(self, touch: Touch, time: float | None = None) -> None:
        """Log the result of one frame."""
        rr, grid = self._rerun, touch.surface
        self._stream.set_time("time", duration=float(touch.time) if time is None else time)  # type: ignore[arg-type]
        values = to_numpy(touch.values).astype(np.float32)
        if grid.dimensions == 1:
            values = values[:, None]
        self._stream.log("pressure", rr.Tensor(values[-1], dim_names=["y", "x"]))
        if grid.dimensions == 2:
            rows, columns = values.shape[1:]
            step = max(1, -(-max(rows, columns) // ARROWS))
            y, x = np.mgrid[step // 2 : rows : step, step // 2 : columns : step]
            shear = values[:2, y, x].reshape(2, -1).T
            longest = max(float(np.abs(values[:2]).max()), 1e-30)
            origins = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
            self._stream.log("shear", rr.Arrows2D(origins=origins, vectors=shear * (step / longest)))
        names = ("x", "z") if grid.dimensions == 1 else ("x", "y", "z")
        low, high = touch.interval(0.95, "force") if touch.has_intervals else (None, None)
        for i, (name, value) in enumerate(zip(names, to_numpy(touch.force))):
            self._stream.log(f"force/{name}", rr.Scalars(float(value)))
            if low is not None and high is not None:
                self._stream.log(f"force/{name}/low", rr.Scalars(float(low[i])))
                self._stream.log(f"force/{name}/high", rr.Scalars(float(high[i])))

    def event(self, event: Event) -> None:
        """Log an event of a `palpate.GraspMonitor`."""
        warning = event.began and event.kind != "contact"
        self._stream.set_time("time", duration=event.time)
        self._stream.log("events", self._rerun.TextLog(str(event), level="WARN" if warning else "INFO"))

    def close(self) -> None:
        """Send the messages that are still queued.

        Raises
        ------
        InvalidInput
            The viewer is gone, or the disk was full: the stream is not whole. Rerun says so only here.
        """
        try:
            self._stream.flush()
        except RuntimeError as error:
            where = "the viewer" if self._path is None else str(self._path)
            raise InvalidInput(f"{where}: Rerun did not receive the whole stream ({error}).") from error
        finally:
            self._stream.disconnect()
