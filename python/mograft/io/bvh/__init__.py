"""BVH files: reading, scanning and writing."""

from mograft.io.bvh.reader import BvhSummary, read_bvh, scan_bvh
from mograft.io.bvh.writer import write_bvh

__all__ = ["BvhSummary", "read_bvh", "scan_bvh", "write_bvh"]
