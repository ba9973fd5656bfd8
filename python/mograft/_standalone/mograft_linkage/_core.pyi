from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["BUILD_PROFILE", "VERSION", "available_memory", "cut", "linkage", "linkage_condensed"]

BUILD_PROFILE: Final[str]
VERSION: Final[str]

def available_memory() -> int: ...
def linkage(
    points: npt.NDArray[np.float64],
    threads: int,
    memory: int,
    progress: Callable[[float], object] | None,
) -> npt.NDArray[np.float64]: ...
def linkage_condensed(
    distances: npt.NDArray[np.float64],
    threads: int,
    memory: int,
    progress: Callable[[float], object] | None,
) -> npt.NDArray[np.float64]: ...
def cut(
    points: npt.NDArray[np.float64],
    max_diameter: float,
    threads: int,
    memory: int,
    progress: Callable[[float], object] | None,
) -> npt.NDArray[np.int64]: ...
