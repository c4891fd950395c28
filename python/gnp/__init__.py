"""GNP: where vehicles on a motorway will be in the next seconds, and why.

    >>> import gnp
    >>> model = gnp.load()                     # the model that comes with the package
    >>> forecasts = model.predict(tracks)      # polars, pandas, PyArrow or NumPy in; the same kind out

Tracks have a row for a vehicle at a moment: `id`, `time` (s), `x`, `y` (m; the centre of the box, in any plane with y to the
left of x), and what is known of `heading` (rad), `speed` or `vx`, `vy` (m/s), `length`, `width` (m), `lane`, `class`.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

# Of the threads that multiply matrices only one kind is needed; the other would wait actively beside it.
os.environ.setdefault("CANDLE_NUM_THREADS", "1")

from ._evaluation import evaluate
from ._gnp import EvaluationError, ForceError, GnpError, ModelError, OnlineError, TracksError, __version__
from ._model import Explanation, GnpWarning, Model, load
from ._tables import Table

if TYPE_CHECKING:
    from . import force, online

__all__ = [
    "EvaluationError",
    "Explanation",
    "ForceError",
    "GnpError",
    "GnpWarning",
    "Model",
    "ModelError",
    "OnlineError",
    "Table",
    "TracksError",
    "__version__",
    "evaluate",
    "force",
    "load",
    "online",
]


def __getattr__(name: str) -> Any:
    # `gnp.force` imports NumPy, which the rest does without.
    if name in ("force", "online"):
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
