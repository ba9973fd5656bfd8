"""The extension module: `mograft._core` if mograft contains this package, else its own `_core`."""

from typing import TYPE_CHECKING

if TYPE_CHECKING or not __name__.startswith("mograft."):
    from . import _core as kernels
else:
    from mograft import _core as kernels

__all__ = ["kernels"]
