from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from ._checks import Floats

__all__ = ["BUILD_PROFILE", "VERSION", "available_memory", "cut", "linkage", "linkage_condensed"]

BUILD_PROFILE: Final[str]
VERSION: Final[str]

def available_memory() -> int: ...
def linkage(
    points: Floats,
    threads: int,
    matrix_bytes: int,
    max_bytes: int | None,
    progress: Callable[[float], object] | None,
) -> npt.NDArray[np.float64]: ...
def linkage_condensed(
    distances: Floats,
    threads: int,
    matrix_bytes: int,
    max_bytes: int | None,
    progress: Callable[[float], object] | None,
) -> npt.NDArray[np.float64]: ...
def cut(
    points: Floats,
    max_diameter: float,
    threads: int,
    matrix_bytes: int,
    max_bytes: int | None,
    progress: Callable[[float], object] | None,
) -> npt.NDArray[np.int64]: ...
