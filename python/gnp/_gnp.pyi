"""The compiled part of gnp."""

from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any, TypedDict

__version__: str

class GnpError(Exception):
    """Whatever goes wrong in gnp; the message says where, what and what to do."""

class TracksError(GnpError):
    """Tracks that cannot be read. `row` (from 0) and `column` say where, None where it is no single place."""

    row: int | None
    column: str | None

class ModelError(GnpError):
    """A model that is not there, is damaged, or does not fit what it is asked."""

class OnlineError(GnpError):
    """A frame that a stream refuses."""

class ForceError(GnpError):
    """A number that the physics does not allow."""

class EvaluationError(GnpError):
    """Forecasts that cannot be scored."""

force: ModuleType

class Remarks(TypedDict):
    """Sentences."""

    #: What was found and assumed.
    notes: list[str]
    #: What was left out.
    left_out: list[str]

class Columns:
    """Columns of one length, by name and in order."""

    def __len__(self) -> int: ...
    def names(self) -> list[str]: ...
    def dtype(self, name: str) -> str: ...
    def fill(self, name: str, out: Any) -> None: ...
    def texts(self, name: str) -> list[str]: ...
    def __arrow_c_stream__(self, requested_schema: object = None) -> object: ...

_Progress = Callable[[str, int, int], object] | None

class Model:
    """A trained model."""

    def __new__(cls, path: object = None, precision: str | None = None) -> Model: ...
    def card(self) -> str: ...
    def predict(
        self,
        source: Any,
        at: list[float] | None,
        every: float | None,
        k: int,
        road: list[list[float]] | None,
        lines: list[float] | None,
        forces: bool,
        threads: int | None,
        progress: _Progress,
    ) -> tuple[Columns, Remarks]: ...
    def explain(
        self,
        source: Any,
        vehicle: str,
        at: float | None,
        road: list[list[float]] | None,
        lines: list[float] | None,
    ) -> tuple[str, float, str, str, Columns, Remarks]: ...

class Stream:
    """A stream of frames of tracks."""

    def __new__(
        cls,
        model: Model,
        lines: list[float],
        k: int,
        road: list[list[float]] | None,
        site: str | None,
        coast_s: float,
        bridge_s: float,
        max_vehicles: int,
        max_rate_hz: float,
        forces: bool,
    ) -> Stream: ...
    def push(self, time_s: float, source: Any) -> Frame: ...
    def set_lines(self, lines: list[float]) -> None: ...
    def reset(self) -> None: ...

class Frame:
    """What a stream gives for a frame."""

    @property
    def time_s(self) -> float: ...
    def shape(self) -> tuple[int, int, int]: ...
    def ids(self) -> list[int]: ...
    def validity(self) -> list[str]: ...
    def reasons(self) -> list[str | None]: ...
    def problems(self) -> list[tuple[int, int, str]]: ...
    def forces(self) -> list[str]: ...
    def fill(self, name: str, out: Any) -> None: ...

def score(
    forecasts: Any,
    source: Any,
    protocol: str,
    name: str,
    observed_s: float,
    road: list[list[float]] | None,
    lines: list[float] | None,
    threads: int | None,
    progress: _Progress,
) -> tuple[Columns, Remarks]: ...
def main(arguments: Sequence[str]) -> int: ...
