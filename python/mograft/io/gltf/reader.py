"""Motions of glTF files."""

from dataclasses import dataclass
from pathlib import Path

from mograft._util.arrays import FloatArray
from mograft._util.containers import LazySequence
from mograft.io.clips import ClipLength, Clips
from mograft.io.gltf.animation import Channels, read_channels, read_tracks
from mograft.io.gltf.document import GltfFile, NoFigureError, read_gltf_file
from mograft.io.gltf.nodes import to_world
from mograft.io.gltf.sampling import DEFAULT_RATE, choose_times, sample
from mograft.io.named_errors import errors_of_file
from mograft.io.rest_pose import rebase
from mograft.motion import limits
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


def open_gltf(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:  # noqa: ARG001
    """Return the clips of a glTF file; see `mograft.io.formats.Opener`."""
    try:
        file = read_gltf_file(path)
    except NoFigureError as error:
        return Clips.without_motions(path, "glTF", (error.message,))
    return Clips(
        path,
        file.clip_names,
        lambda clip: read_gltf_clip(file, clip, rate),
        "glTF",
        file.notes,
        _Lengths(file, rate),
    )


@dataclass(frozen=True, eq=False)
class _Lengths(LazySequence[ClipLength]):
    """The lengths of the clips of a file; accessing a length reads the key times of the clip."""

    file: GltfFile
    rate: float | None

    def __len__(self) -> int:
        return len(self.file.animations)

    def item(self, index: int) -> ClipLength:
        """Return the length of a clip."""
        return _length(_read_grid(self.file, index, self.rate)[1], self.rate)


def read_gltf_clip(file: GltfFile, clip: int, rate: float | None = None) -> Motion:
    """Return the motion of a clip, sampled from its first to its last key.

    `rate` is in frames per second. By default it is that of the keys if these lie on a uniform grid
    of 12 to 500 frames per second, else 30. Raises `FormatError` if the animation is invalid.
    """
    channels, times = _read_grid(file, clip, rate)
    animation = read_tracks(file.container, channels)
    local = sample(animation, times, file.moved_rest, file.moved_rows)
    turned, positions = to_world(file.moved_parents, local)
    name, first = file.clip_names[clip], len(file.above)
    return rebase(
        file.rest,
        turned[:, first:],
        positions[:, first:],
        _length(times, rate).frame_time,
        name=name,
        path=file.container.path,
        clip=name if len(file.clip_names) > 1 else None,
    )


def _read_grid(file: GltfFile, clip: int, rate: float | None) -> tuple[Channels, FloatArray]:
    """Return the channels of a clip, and the times of its frames."""
    animation, nodes = file.animations[clip], file.moved_nodes
    container = file.container
    channels = read_channels(container, animation, frozenset(nodes.tolist()))
    with errors_of_file(container.path, channels.place):
        times = choose_times(channels.key_times, rate, len(nodes), container.n_bytes)
        limits.check_frame_time(_length(times, rate).frame_time)
    return channels, times


def _length(times: FloatArray, rate: float | None) -> ClipLength:
    """Return the length of a clip with frames at the given times."""
    if len(times) == 1:
        return ClipLength(1, 1.0 / (rate or DEFAULT_RATE))
    return ClipLength(len(times), float(times[-1] - times[0]) / (len(times) - 1))
