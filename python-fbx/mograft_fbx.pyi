from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
import numpy.typing as npt

BUILD_PROFILE: str
VERSION: str

@final
class Scene:
    def __new__(cls, data: bytes, memory_limit: int, *, with_geometry: bool = False) -> Scene: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def parents(self) -> npt.NDArray[np.int64]: ...
    @property
    def kinds(self) -> list[str]: ...
    @property
    def takes(
        self,
    ) -> list[tuple[str, tuple[float, float], tuple[float, float] | None, list[int]]]: ...
    @property
    def settings(self) -> tuple[int, bool, float, str, float]: ...
    @property
    def n_constraints(self) -> int: ...
    @property
    def textures(self) -> list[str]: ...
    def to_glb(
        self,
        joints: Sequence[int],
        names: Sequence[str],
        textures: Mapping[str, bytes],
        *,
        generator: str,
        max_corners: int,
    ) -> tuple[bytes, list[str]] | None: ...
    def rest_pose(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
    def bake(
        self, take: int, joints: Sequence[int], *, begin: float, rate: float, n_frames: int
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]: ...
