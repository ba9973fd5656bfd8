"""Read AMASS files: rotation vectors of the joints of SMPL, SMPL-H or SMPL-X."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.errors import join_names
from mograft.io.clips import ClipLength, Clips
from mograft.io.named_errors import errors_of_file
from mograft.io.npz_archive import NpzArchive, open_npz_archive
from mograft.io.smpl.joints import MODELS, SMPL_H, SMPL_X, BodyModel
from mograft.io.smpl.rest import rest_skeleton
from mograft.motion import limits, rotations
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_RATE_NAMES = ("mocap_framerate", "mocap_frame_rate")


@dataclass(frozen=True, eq=False)
class AmassFile:
    """The headers of an AMASS file."""

    archive: NpzArchive
    model: BodyModel
    n_frames: int
    rate_name: str | None  # of the array with the frames per second; None if there is none

    @property
    def pose_names(self) -> tuple[str, ...]:
        """Names of the arrays with rotations: ``poses``, arrays of parts of it, or both."""
        return tuple(n for n in ("poses", *self.model.columns) if n in self.archive.headers)

    def columns(self, name: str) -> slice:
        """Return the columns of ``poses`` that an array of `pose_names` holds."""
        return slice(0, self.model.n_columns) if name == "poses" else self.model.columns[name]

    def poses(self) -> FloatArray:
        """Read the rotation vectors, shape (n_frames, n_columns); zero for absent parts."""
        names = ("poses",) if "poses" in self.pose_names else self.pose_names
        vectors = np.zeros((self.n_frames, self.model.n_columns))
        for name in names:
            columns = self.columns(name)
            shape = (self.n_frames, columns.stop - columns.start)
            vectors[:, columns] = self.archive.read_floats(name, shape)
        return vectors

    def translations(self) -> FloatArray:
        """Read the translations of the body, shape (n_frames, 3)."""
        return self.archive.read_floats("trans", (self.n_frames, 3))

    def rate(self, given: float | None) -> float:
        """Return the frames per second that the file states, or `given` if it states none.

        Raises `FormatError` if the file states none and `given` is None, or if the rate is invalid.
        """
        if self.rate_name is None:
            if given is None:
                raise self.archive.error(
                    _RATE_NAMES[0], "expected frames per second, got no such array; give a rate"
                )
            return given
        shape = () if self.archive.headers[self.rate_name].shape == () else (1,)
        rate = float(self.archive.read_floats(self.rate_name, shape).reshape(()))
        if not rate > 0:
            raise self.archive.error(self.rate_name, f"expected frames per second, got {rate:g}")
        with errors_of_file(self.archive.path, f"array `{self.rate_name}`"):
            limits.check_frame_time(1.0 / rate)
        return rate


def open_amass_file(path: Path) -> AmassFile:
    """Check the headers of an AMASS file; raise `FormatError` if a shape is wrong."""
    archive = open_npz_archive(path)
    if "poses" in archive.headers:
        n_frames, n_columns = archive.header("poses", ("n_frames", "n_columns")).shape
        model = next((model for model in MODELS if model.n_columns == n_columns), None)
        if model is None:
            known = ", ".join(f"{model.n_columns} ({model.name})" for model in MODELS)
            raise archive.error("poses", f"expected {known} columns, got {n_columns}")
    else:
        n_frames = archive.header("root_orient", ("n_frames", 3)).shape[0]
        has_face = {"pose_jaw", "pose_eye"} & archive.headers.keys()
        model = SMPL_X if has_face else SMPL_H
    if n_frames == 0:
        name = "poses" if "poses" in archive.headers else "root_orient"
        raise archive.error(name, "expected at least one frame, got none")
    with errors_of_file(path):
        limits.check_frames(n_frames)
    rate_name = next((name for name in _RATE_NAMES if name in archive.headers), None)
    file = AmassFile(archive, model, n_frames, rate_name)
    for name in file.pose_names:
        columns = file.columns(name)
        archive.header(name, (n_frames, columns.stop - columns.start))
    archive.header("trans", (n_frames, 3))
    return file


def to_motion(file: AmassFile, rest: Skeleton, rate: float | None) -> Motion:
    """Return the motion of an AMASS file, given the rest skeleton of its body model.

    `rate` is used if the file states no frame rate.
    """
    vectors = file.poses().reshape(file.n_frames, -1, 3)
    positions = np.tile(rest.offsets, (file.n_frames, 1, 1))
    positions[:, 0] += file.translations()
    path = file.archive.path
    return Motion(
        rest,
        1.0 / file.rate(rate),
        rotations.continuous_signs(rotations.exp(vectors)),
        positions,
        name=path.stem,
        path=path,
    )


def open_amass(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
    """Return the clip of an AMASS file; see `mograft.io.formats.Opener`.

    Local rotations are those of ``poses``. World axes are those of the file (z up in AMASS), and
    lengths are in metres. The position of the pelvis is ``trans`` plus its rest position.
    """
    file = open_amass_file(path)
    rest, note = rest_skeleton(file.model, skeleton)

    def load(_: int) -> Motion:
        with errors_of_file(path):
            motion = to_motion(file, rest, rate)
        return motion if rate is None else motion.resample(rate)

    return Clips(
        path,
        (path.stem,),
        load,
        f"AMASS {file.model.name}",
        notes=(note, *_notes(file)),
        lengths=(ClipLength(file.n_frames, 1.0 / file.rate(rate)),),
    )


def _notes(file: AmassFile) -> list[str]:
    """Return notes on a missing rate, missing parts, and arrays that are not in the motion."""
    used = {*file.pose_names, "trans", file.rate_name}
    headers = file.archive.headers
    kept = [name for name, header in headers.items() if name not in used and not header.is_pickled]
    pickled = [name for name, header in headers.items() if header.is_pickled]
    notes = []
    if file.rate_name is None:
        notes.append("frames per second: those given, because the file states none")
    if "poses" not in file.pose_names:
        absent = [name for name in file.model.columns if name not in file.pose_names]
        notes += [f"poses: zero for {join_names(absent)}"] if absent else []
    if kept:
        notes.append(f"arrays that are not part of the motion: {join_names(kept)}")
    if pickled:
        notes.append(f"arrays of pickled objects, which are not read: {join_names(pickled)}")
    return notes
