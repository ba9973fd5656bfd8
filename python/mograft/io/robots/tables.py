"""Tables of joint angles: CSV files with the root and the angle of each hinge in every frame."""

import io
import os
import warnings
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mograft._util.arrays import FloatArray
from mograft._util.atomic import write_text
from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips, errors_of_file, single_clip
from mograft.io.robots import poses
from mograft.motion import rotations
from mograft.motion.hinges import Hinges, TableLayout
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

MAX_TABLE_BYTES = 1 << 29

_EULER = "xyz"
"""The order of a root with three angles: about fixed axes, x first. Headers name them."""

_FRAMES = ("frame", "index", "frame_index", "")
_TIMES = ("time", "t", "timestamp", "seconds")
_ENDINGS = ("", "_dof", "_pos", "_rad", "_deg")
_TURNS = ("quat", "rot", "orient", "q")


class _Columns(NamedTuple):
    """The columns of a table."""

    frame: int | None
    time: int | None
    positions: list[int]  # x, y and z of the root
    turns: list[int]  # the four or three numbers of its rotation, in the order of the file
    order: str  # of a quaternion, if the header states it; "xyz" for three angles
    angles: list[int]  # one for each hinge


def open_table(path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
    """Return the clip of a table; see `mograft.io.formats.Opener`.

    `skeleton` is the result of `read_model`. Without header, the columns are the position and the
    quaternion of the root, and one angle for each hinge in the order of the model.
    """
    model = skeleton
    if model is None or model.hinges is None:
        return single_clip(path, "robot CSV", lambda: poses.refuse_without_model(path), rate)
    header, values, first = _read_cells(path)
    stated = model.hinges.layout
    with errors_of_file(path):
        columns = _find_columns(header, values.shape[1], model.hinges)
        unit = poses.find_unit(model, values[:, columns.positions[2]])
        angles = values[:, columns.angles]
        turn = poses.find_angle_unit(model.hinges, angles)
        is_euler = columns.order == _EULER
        known = _EULER if is_euler else stated.quaternion or columns.order
        places, turns = values[:, columns.positions], values[:, columns.turns]
        pose = poses.Pose(unit * places, turn * turns if is_euler else turns, turn * angles)
        pose, order, evidence = _find_turns(model, pose, known)
        seconds, origin = _frame_time(stated, values, columns, path)
        digits = max(len(cell.lower().partition("e")[0].partition(".")[2]) for cell in first)
        layout = TableLayout(
            quaternion=order,
            header=header,
            unit=unit,
            is_degrees=turn != 1.0,
            numbers=f".{digits}{'e' if any('e' in cell.lower() for cell in first) else 'f'}",
            is_single=bool((values == values.astype(np.float32)).all()),
        )
        motion = poses.to_motion(model, pose, layout, seconds)
    units = f"units: {poses.UNITS[unit]} and {'degrees' if layout.is_degrees else 'rad'}"
    notes = (f"quaternion: {evidence}", units, f"frames per second: {origin}")
    return single_clip(path, "robot CSV", lambda: motion, rate, notes=notes)


def write_table(motion: Motion, path: str | os.PathLike[str]) -> None:
    """Write the root and the joint angles of a robot's motion, one line per frame.

    Parameters
    ----------
    motion : Motion
        The motion of a robot, whose skeleton has `hinges`.
    path : str or path
        The file to write. It has the layout of the file from which the motion, or the base of a
        graft, was read: numbers that were not changed are the same. The quaternion of other motions
        is xyzw.

    Raises
    ------
    ValueError
        If the skeleton has no hinges.
    OSError
        If the file cannot be written.
    """
    pose, hinges = poses.to_pose(motion), poses.hinges_of(motion.skeleton)
    layout = hinges.layout
    n_columns = len(layout.header) or 7 + len(hinges.names)
    columns = _find_columns(layout.header, n_columns, hinges)
    values = np.zeros((motion.n_frames, n_columns))
    values[:, columns.positions] = pose.positions / layout.unit
    degrees = 180.0 / np.pi if layout.is_degrees else 1.0
    values[:, columns.angles] = degrees * pose.angles
    if layout.quaternion == _EULER:
        values[:, columns.turns] = degrees * rotations.to_euler(pose.quats, "ZYX")[:, ::-1]
    else:
        order = np.argsort(poses.COLUMNS_OF_ORDER[layout.quaternion or "xyzw"])
        values[:, columns.turns] = _as_stored(pose.quats[:, order], layout)
    if columns.time is not None:
        values[:, columns.time] = np.arange(motion.n_frames) * motion.frame_time
    values, forms = _stored(values, layout), [f"%{layout.numbers}"] * n_columns
    if columns.frame is not None:
        values[:, columns.frame] = np.arange(motion.n_frames)
        forms[columns.frame] = "%d"
    text = io.StringIO()
    np.savetxt(text, values, forms, ",", header=",".join(layout.header), comments="")
    write_text(Path(path), text.getvalue())


def _as_numbers(cells: Sequence[str]) -> FloatArray | None:
    """Return the numbers in cells; None if one is not a finite number."""
    try:
        values = np.array(cells, np.float64)
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _read_cells(path: Path) -> tuple[tuple[str, ...], FloatArray, list[str]]:
    """Return the header, the values, and the first row as text.

    Raises `FormatError` with the line if a cell is not a finite number or rows differ in length.
    """
    with path.open("rb") as file:
        data = file.read(MAX_TABLE_BYTES + 1)
    if len(data) > MAX_TABLE_BYTES:
        raise FormatError(f"expected at most {MAX_TABLE_BYTES >> 20} MiB, got more", path)
    header, first, rows = tuple[str, ...](), list[str](), list[FloatArray]()
    for line, text in enumerate(data.decode("utf-8-sig", "replace").splitlines(), 1):
        if not text.strip():
            continue
        cells = [cell.strip() for cell in (text.split(",") if "," in text else text.split())]
        values = _as_numbers(cells)
        if not first and not header and values is None and "nan" not in map(str.lower, cells):
            header = tuple(cells)
            continue
        first = first or cells
        if values is None or len(cells) != len(header or first):
            wrong = [cell for cell in cells if _as_numbers([cell]) is None]
            got = repr(wrong[0][:40]) if wrong else f"{len(cells)} numbers"
            expected = f"{len(header or first)} finite numbers"
            raise FormatError(f"expected {expected}, got {got}", path, f"line {line}")
        rows.append(values)
    if not rows:
        raise FormatError("expected at least one row of numbers, got none", path)
    return header, np.array(rows), first


def _find_columns(header: Sequence[str], n_columns: int, hinges: Hinges) -> _Columns:
    """Return the columns of a table; raise ValueError if they do not fit the model."""
    n = len(hinges.names)
    if not header:
        if n_columns != 7 + n:
            expected = f"{7 + n} columns: position and quaternion of the root, {n} joints"
            raise ValueError(f"expected {expected}, got {n_columns}")
        return _Columns(None, None, [0, 1, 2], [3, 4, 5, 6], "", list(range(7, 7 + n)))
    names = [name.strip().strip('"').lower() for name in header]
    frame = next((c for c, name in enumerate(names) if name in _FRAMES), None)
    time = next((c for c, name in enumerate(names) if name in _TIMES), None)
    number_of = {
        f"{base}{end}": number
        for number, hinge in enumerate(map(str.lower, hinges.names))
        for base in (hinge.removesuffix("_joint"), hinge)
        for end in _ENDINGS
    }
    column_of = {number_of[name]: c for c, name in enumerate(names) if name in number_of}
    missing = [name for number, name in enumerate(hinges.names) if number not in column_of]
    if missing:
        raise ValueError(f"expected columns for {join_names(missing)} of the model, got none")
    angles = [column_of[number] for number in range(n)]
    rest = [c for c in range(len(names)) if c not in (frame, time, *angles)]
    turns = [c for c in rest if any(part in names[c] for part in _TURNS)]
    places = [c for c in rest if c not in turns]
    order, axes = ("".join(names[c][-1:] for c in own) for own in (turns, places))
    if axes not in ("xyz", "012") or not (order == _EULER or len(turns) == 4):
        expected = "x, y, z and quaternion, or three angles x, y, z, of the root"
        got = join_names([header[c] for c in rest])
        raise ValueError(f"expected {expected} besides the joints, got {got}")
    order = order if order in (*poses.COLUMNS_OF_ORDER, _EULER) else ""
    return _Columns(frame, time, places, turns, order, angles)


def _find_turns(model: Skeleton, pose: poses.Pose, order: str) -> tuple[poses.Pose, str, str]:
    """Return the pose with quaternions xyzw, their order in the file, and a text about it.

    Raises ValueError if they are not unit quaternions or their order is ambiguous.
    """
    if order == _EULER:
        quats = rotations.from_euler(pose.quats[:, ::-1].copy(), "ZYX")
        return pose._replace(quats=quats), order, "none, but angles about fixed axes, x first"
    errors = np.abs(np.linalg.norm(pose.quats, axis=1) - 1.0)
    if errors.max() > poses.MAX_NORM_ERROR:
        got = f"one with a norm that differs by {errors.max():.2g} in frame {errors.argmax()}"
        raise ValueError(f"expected unit quaternions of the root, got {got}")
    text = f"{order}, as stated"
    if not order:
        order, text = poses.find_quaternion_order(model, pose)
    return pose._replace(quats=pose.quats[:, poses.COLUMNS_OF_ORDER[order]]), order, text


def _frame_time(
    stated: TableLayout, values: FloatArray, columns: _Columns, path: Path
) -> tuple[float, str]:
    """Return the seconds from frame to frame, and a text about their origin."""
    for pattern, rate in stated.rates:
        if fnmatchcase(path.name, pattern) or fnmatchcase(path.stem, pattern):
            return 1.0 / rate, f"{rate:g}, as stated"
    if columns.time is None or len(values) == 1:
        text = f"{poses.DEFAULT_RATE:g} is assumed; the file states none (--fps)"
        warnings.warn(f"frames per second of robot tables: {text}", stacklevel=2)
        return 1.0 / poses.DEFAULT_RATE, text
    steps = np.diff(values[:, columns.time])
    seconds = float(steps.mean())
    if seconds <= 0.0 or np.abs(steps - seconds).max() > 0.1 * seconds:
        raise ValueError("expected times at equal steps, got others")
    return seconds, f"{1.0 / seconds:.6g}, from the times"


def _stored(values: FloatArray, layout: TableLayout) -> FloatArray:
    """Return the nearest values that the file can hold."""
    if layout.is_single:
        return values.astype(np.float32).astype(np.float64)
    if layout.numbers.endswith("f"):
        return values.round(int(layout.numbers[1:-1]))
    return values


def _as_stored(quats: FloatArray, layout: TableLayout) -> FloatArray:
    """Return quaternions as the file had them before they were divided by their norm, (n, 4).

    A norm differs from 1 because its numbers are rounded. The largest number of a quaternion and
    its neighbours at the file's precision give the norms that are possible; one with which all
    numbers of the quaternion have this precision is that of the file.
    """
    rows = np.arange(len(quats))
    largest = quats[rows, np.abs(quats).argmax(axis=1)]
    step = 2.0**-24 if layout.is_single else 10.0 ** -int(layout.numbers[1:-1])
    best, least = quats, np.full(len(quats), 1e-2 * step)
    for count in range(-4, 5):
        target = _stored(largest + count * step, layout)
        scaled = quats * (target / largest)[:, None]
        error = np.abs(_stored(scaled, layout) - scaled).max(axis=1)
        is_better = error < least
        best = np.where(is_better[:, None], _stored(scaled, layout), best)
        least = np.where(is_better, error, least)
    return best
