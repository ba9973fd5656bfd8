"""Files for other programs: GLB to look at, NPZ to compute with, CSV to tabulate.

BVH, which mograft reads as well, is in `mograft.bvh`.
"""

from mograft.formats.glb import unit_of, write_glb
from mograft.formats.tables import read_npz, write_csv, write_npz

__all__ = ["read_npz", "unit_of", "write_csv", "write_glb", "write_npz"]
