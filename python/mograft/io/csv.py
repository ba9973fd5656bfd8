"""CSV: world positions of the joints, and tables that a spreadsheet reads as texts."""

import csv
import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from mograft._util.atomic import write_bytes
from mograft.motion.motion import Motion


def write_csv(motion: Motion, path: str | os.PathLike[str]) -> None:
    """Write the world positions of the joints, one line per frame.

    Parameters
    ----------
    motion : Motion
        The motion.
    path : str or path
        The file to write.

    Notes
    -----
    The columns are ``frame``, from 0; ``time`` in seconds; and ``joint.x``, ``joint.y`` and
    ``joint.z`` of each joint, in the unit and the axes of the motion. If several joints have the
    same name, their index is appended, as in ``Spine~4.x``. A name that a spreadsheet would read
    as a formula is prefixed with an apostrophe.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> target = Path(tempfile.mkdtemp()) / "dance.csv"
    >>> write_csv(dance(strides=1).motion[:2], target)
    >>> target.read_text().split(",")[:3]
    ['frame', 'time', 'Hips.x']
    """
    names = motion.skeleton.names
    columns = ["frame", "time"]
    for joint, name in enumerate(names):
        column = name if names.count(name) == 1 else f"{name}~{joint}"
        column = without_formula(column)
        columns += [f"{column}.{axis}" for axis in "xyz"]
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    table = motion.world_positions().reshape(motion.n_frames, -1)
    for frame, row in enumerate(table.tolist()):
        time = f"{frame * motion.frame_time:.9g}"
        writer.writerow([frame, time, *(f"{value:.9g}" for value in row)])
    write_bytes(Path(path), buffer.getvalue().encode("utf-8", "replace"))


def without_formula(text: str) -> str:
    """Return a text, prefixed with an apostrophe if a spreadsheet would read it as a formula."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def to_csv(rows: Iterable[Sequence[object]]) -> bytes:
    """Return rows as CSV, with an apostrophe before texts that a spreadsheet would compute."""
    text = io.StringIO(newline="")
    safe = ([without_formula(own) if isinstance(own, str) else own for own in row] for row in rows)
    csv.writer(text, lineterminator="\n").writerows(safe)
    return text.getvalue().encode("utf-8", "replace")
