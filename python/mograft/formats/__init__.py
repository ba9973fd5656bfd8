"""Files for other programs: GLB and USD to look at, NPZ to compute with, CSV to tabulate.

BVH, which mograft reads as well, is in `mograft.bvh`.
"""

from mograft.formats.figure import unit_of
from mograft.formats.glb import write_glb
from mograft.formats.tables import read_npz, write_csv, write_npz
from mograft.formats.usd import write_usd

__all__ = ["read_npz", "unit_of", "write_csv", "write_glb", "write_npz", "write_usd"]
