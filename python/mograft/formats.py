"""Readers and writers of single formats; `mograft.read` and `mograft.write` choose by the file."""

from mograft.io.bvh.reader import read_bvh
from mograft.io.bvh.writer import write_bvh
from mograft.io.csv import write_csv
from mograft.io.glb import write_glb
from mograft.io.gltf.writer import write_glb_animations
from mograft.io.npz import write_npz
from mograft.io.robots.model import read_model
from mograft.io.robots.tables import write_table
from mograft.io.robots.trackers import write_tracker
from mograft.io.smpl.amass import write_amass
from mograft.io.usd import write_usd

__all__ = [
    "read_bvh",
    "read_model",
    "write_amass",
    "write_bvh",
    "write_csv",
    "write_glb",
    "write_glb_animations",
    "write_npz",
    "write_table",
    "write_tracker",
    "write_usd",
]
