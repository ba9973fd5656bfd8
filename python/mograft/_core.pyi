"""Compiled kernels of mograft. Private: call the package's own functions instead."""

from collections.abc import Sequence
from typing import Final

from mograft._standalone.mograft_linkage._core import available_memory as available_memory
from mograft._standalone.mograft_linkage._core import cut as cut
from mograft._standalone.mograft_linkage._core import linkage as linkage
from mograft._standalone.mograft_linkage._core import linkage_condensed as linkage_condensed
from mograft._util.arrays import BoolArray, FloatArray, IntArray, Packed

__all__ = [
    "BUILD_PROFILE",
    "VERSION",
    "add_offsets",
    "added_imbalances",
    "angle",
    "available_memory",
    "box_clearance",
    "capsule_ends",
    "clearance",
    "clip_states",
    "continuous_signs",
    "cubic",
    "cubic_positions",
    "cut",
    "distances",
    "exp",
    "features",
    "format_rows",
    "from_channels",
    "from_euler",
    "greatest_derivatives",
    "hermite",
    "keep_cheapest",
    "kinetic_energy",
    "linkage",
    "linkage_condensed",
    "local",
    "log",
    "moments",
    "multiply",
    "pose_gaps",
    "pose_gaps_along",
    "replace_joints",
    "rotate",
    "sample",
    "sample_clips",
    "sample_keys",
    "scan_numbers",
    "segments",
    "segments_positions",
    "slerp",
    "smooth_gradient",
    "to_euler",
    "velocity_gaps",
    "velocity_gaps_along",
    "world",
    "world_jerk",
]

BUILD_PROFILE: Final[str]
VERSION: Final[str]

def exp(vectors: FloatArray) -> FloatArray: ...
def log(rotations: FloatArray) -> FloatArray: ...
def multiply(a: FloatArray, b: FloatArray) -> FloatArray: ...
def rotate(rotations: FloatArray, vectors: FloatArray) -> FloatArray: ...
def moments(rows: Packed | FloatArray, shape: tuple[int, int]) -> FloatArray: ...
def features(
    rows: Packed | FloatArray,
    shape: tuple[int, int],
    joints: IntArray,
    references: FloatArray,
    n_rest: int,
    threads: int,
) -> FloatArray: ...
def angle(a: FloatArray, b: FloatArray) -> FloatArray: ...
def from_channels(
    values: FloatArray, starts: Sequence[int], turns: Sequence[tuple[int, int]], radians: float
) -> FloatArray: ...
def continuous_signs(rotations: FloatArray) -> FloatArray: ...
def from_euler(angles: FloatArray, axes: Sequence[int]) -> FloatArray: ...
def to_euler(
    rotations: FloatArray, axes: tuple[int, int, int], near: tuple[float, float, float]
) -> FloatArray: ...
def hermite(
    start: FloatArray,
    end: FloatArray,
    start_velocity: FloatArray,
    end_velocity: FloatArray,
    t: FloatArray,
) -> FloatArray: ...
def slerp(frame_times: FloatArray, rotations: FloatArray, times: FloatArray) -> FloatArray: ...
def cubic(frame_times: FloatArray, rotations: FloatArray, times: FloatArray) -> FloatArray: ...
def cubic_positions(
    frame_times: FloatArray, positions: FloatArray, times: FloatArray
) -> FloatArray: ...
def segments(
    rotations: FloatArray, starts: IntArray, stops: IntArray, counts: IntArray
) -> FloatArray: ...
def segments_positions(
    positions: FloatArray, starts: IntArray, stops: IntArray, counts: IntArray
) -> FloatArray: ...
def sample_keys(
    times: FloatArray,
    key_times: FloatArray,
    key_starts: IntArray,
    values: FloatArray,
    tracks: IntArray,
) -> FloatArray: ...
def world(
    parents: IntArray, rotations: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]: ...
def local(
    parents: IntArray, rotations: FloatArray, positions: FloatArray
) -> tuple[FloatArray, FloatArray]: ...
def greatest_derivatives(
    rotations: FloatArray, joints: IntArray
) -> tuple[FloatArray, FloatArray]: ...
def world_jerk(
    parents: IntArray, rotations: FloatArray, positions: FloatArray, joints: IntArray
) -> FloatArray: ...
def pose_gaps(ends: FloatArray, starts: FloatArray) -> FloatArray: ...
def pose_gaps_along(
    ends: FloatArray, starts: FloatArray, candidates: IntArray, counts: IntArray
) -> FloatArray: ...
def capsule_ends(
    rotations: FloatArray, positions: FloatArray, joints: IntArray, bones: FloatArray
) -> FloatArray: ...
def clearance(
    ends: FloatArray,
    radii: FloatArray,
    others: FloatArray,
    other_radii: FloatArray,
    other_frames: IntArray,
    pairs: tuple[IntArray, IntArray],
) -> tuple[FloatArray, IntArray]: ...
def box_clearance(
    ends: FloatArray,
    radii: FloatArray,
    center: Sequence[float],
    half: Sequence[float],
    rotation: Sequence[float],
) -> FloatArray: ...
def velocity_gaps(ends: FloatArray, starts: FloatArray) -> FloatArray: ...
def velocity_gaps_along(
    ends: FloatArray, starts: FloatArray, candidates: IntArray, counts: IntArray
) -> FloatArray: ...
def distances(points: FloatArray, from_: IntArray, to: IntArray, /) -> FloatArray: ...
def keep_cheapest(
    counts: IntArray, costs: FloatArray, is_first: BoolArray, limit: int
) -> tuple[IntArray, IntArray]: ...
def sample(
    counts: IntArray, unary: FloatArray, pairwise: FloatArray, temperature: float, draws: FloatArray
) -> IntArray: ...
def replace_joints(
    base: FloatArray, part: FloatArray, joints: IntArray
) -> tuple[FloatArray, BoolArray]: ...
def sample_clips(clips: Sequence[FloatArray], clip: IntArray, times: FloatArray) -> FloatArray: ...
def clip_states(
    clips: Sequence[FloatArray], clip: IntArray, frames: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]: ...
def add_offsets(
    values: FloatArray,
    times: tuple[IntArray, FloatArray, FloatArray, FloatArray],
    before: tuple[FloatArray, FloatArray],
    after: tuple[FloatArray, FloatArray],
) -> FloatArray: ...
def added_imbalances(
    offsets: FloatArray,
    bases: tuple[IntArray, FloatArray, FloatArray],
    donors: tuple[IntArray, IntArray],
    directions: FloatArray,
    scale: float,
    threads: int,
) -> FloatArray: ...
def smooth_gradient(
    values: FloatArray,
    donors: tuple[IntArray, IntArray, FloatArray, IntArray, FloatArray],
    weights: Sequence[float],
    limits: tuple[float, int, float],
) -> None: ...
def kinetic_energy(
    parents: IntArray, rotations: FloatArray, inertia: FloatArray, frame_time: float, omega: str
) -> FloatArray: ...
def scan_numbers(
    text: bytes, start: int, capacity: int
) -> tuple[FloatArray, IntArray, IntArray, int, bool]: ...
def format_rows(values: FloatArray) -> bytes: ...
