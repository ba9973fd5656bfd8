"""The extension module: as a part of mograft the one of mograft, else the one of this package."""

from typing import TYPE_CHECKING

if TYPE_CHECKING or not __name__.startswith("mograft."):
    from . import _core as kernels
else:
    from mograft import _core as kernels

__all__ = ["kernels"]
