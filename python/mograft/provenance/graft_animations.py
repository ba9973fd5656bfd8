"""Grafts as animations in a copy of the glTF file of their base."""

from collections.abc import Sequence
from pathlib import Path

from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.writer import Addition, append_animations, has_duration
from mograft.library.discover import SourceFile
from mograft.library.origin import ClipOrigin, find_clip_origin
from mograft.synthesis.graft_result import Graft


def add_graft_animations(grafts: Sequence[Graft], path: Path) -> tuple[tuple[str, ...], bytes]:
    """Return the names of the animations of grafts, and the copy of a file that has them.

    The file is the glTF file of the bases; `path` is the one to write. Joints that a graft does not
    change keep the tracks of its base, if the base is a clip of the file. Raises ValueError if the
    bases are not from one glTF file.
    """
    files = [find_base_file(graft, "glTF") for graft in grafts]
    for graft, file in zip(grafts, files, strict=True):
        if file is None:
            raise ValueError(
                f"{path.name} must be a .bvh file: {graft.base.name}, the base of "
                f"{graft.motion.name}, is not from a glTF file; to write a new .glb file, "
                "use mograft export"
            )
    paths = list(dict.fromkeys(file.path for file in files if file is not None))
    if len(paths) > 1:
        raise ValueError(
            f"the bases of all grafts must be from one glTF file to be written to {path.name}, got "
            f"{', '.join(paths)}"
        )
    source = read_gltf_file(Path(paths[0]))
    return append_animations(source, [_addition(source, graft) for graft in grafts])


def find_base_file(graft: Graft, form: str) -> SourceFile | None:
    """Return the first file of a format from which a base was read; None without one."""
    for clip in _base_clips(graft):
        file = find_clip_origin(graft.library, clip).source_file
        if file is not None and file.format == form:
            return file
    return None


def _base_clips(graft: Graft) -> list[int]:
    """Return the clips of the base segments in the order of the motion, each once."""
    clips = graft.library.segments.clip[[own.segment for own in graft.substitutions]]
    return list(dict.fromkeys(clips.tolist()))


def _addition(file: GltfFile, graft: Graft) -> Addition:
    """Return the motion of a graft, with its base if this is the motion of a clip of the file."""
    origin: ClipOrigin = find_clip_origin(graft.library, _base_clips(graft)[0])
    source = origin.source_file
    if graft.scenario or origin.is_mirrored or source is None:
        return Addition(graft.motion)
    clip = 0 if source.clip is None else file.clip_names.index(source.clip)
    # A base whose frame rate was corrected has another duration than the clip.
    if not has_duration(file, clip, graft.base):
        return Addition(graft.motion)
    return Addition(graft.motion, graft.base, clip)
