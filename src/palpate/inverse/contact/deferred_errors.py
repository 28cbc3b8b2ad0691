"""Errors of a large contact, computed on first access because they take a third of the time of a frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate._batches import Deferred
from palpate.elastic.pad import Floats
from palpate.inverse.contact.summary import Summary
from palpate.inverse.estimate import Errors

__all__ = ["ContactErrors"]

_NAMES = tuple(f.name for f in fields(Errors))


class ContactErrors(Deferred, Errors):
    """`Errors` of one frame, each field computed on first access. The models are released when all fields are known."""

    _made_of: Summary
    _cut: Callable[[Floats], Floats]
    _frames: npt.NDArray[np.int_]

    @classmethod
    def of(cls, summary: Summary, cut: Callable[[Floats], Floats], frames: npt.NDArray[np.int_]) -> ContactErrors:
        """Errors from a ``summary``. ``cut`` returns the part of a field that lies on the surface; ``frames`` is an
        array of zeros with the shape of the batch.
        """
        out: ContactErrors = object.__new__(cls)
        for name, value in (("_made_of", summary), ("_cut", cut), ("_frames", frames)):
            object.__setattr__(out, name, value)
        return out

    def __getattr__(self, name: str) -> Any:
        summary = self.__dict__.get("_made_of")
        if summary is None or name not in _NAMES:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        value = summary.of(name)
        if value.ndim > summary.grid.dimensions:  # a field
            value = self._cut(value)
        value = np.broadcast_to(value, (*self._frames.shape, *value.shape)).copy()
        value.flags.writeable = False
        object.__setattr__(self, name, value)
        if all(n in self.__dict__ for n in _NAMES):
            object.__delattr__(self, "_made_of")
        return value

    def __reduce__(self) -> Any:
        return Errors, tuple(getattr(self, name) for name in _NAMES)  # a pickled copy needs no models

    @property
    def deferred(self) -> bool:
        """Whether some field has not been computed yet."""
        return "_made_of" in self.__dict__

    def inputs(self) -> Iterator[tuple[str, Any]]:
        """Yield the arrays that have the batch axes."""
        yield "frame", self._frames

    def changed(self, change: Callable[[Any], Any]) -> ContactErrors:
        """Apply ``change``, an index operation on batch axes, to computed fields and to those still to be computed."""
        out = self.of(self._made_of, self._cut, np.asarray(change(self._frames)))
        for name in _NAMES:
            if name in self.__dict__:
                object.__setattr__(out, name, change(self.__dict__[name]))
        return out
