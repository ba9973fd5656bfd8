"""`Scenario`: a sequence of base segments."""

from dataclasses import dataclass

from mograft._util.arrays import FloatArray, IntArray, as_floats, as_indices, make_read_only


@dataclass(frozen=True, eq=False)
class Scenario:
    """A sequence of base segments, their lengths, and the position and turn of the first.

    Parameters
    ----------
    segments : array_like of int, shape (n,)
        Segments of a library, in order.
    lengths : array_like of int, shape (n,), optional
        Length of each segment in frame intervals. Default: the captured lengths.
    place : array_like, shape (3,), optional
        Position of the root over the floor in the first frame, in the file's unit; the component
        along the up axis is ignored. Default: the captured position.
    turn : float
        Rotation of the first segment about the up axis, in radians.

    Raises
    ------
    ValueError
        If there is no segment, if `lengths` does not have one entry per segment, if a length is
        below 1, or if a number is not finite.

    Examples
    --------
    >>> Scenario([3, 4, 0], turn=0.5)
    Scenario(3 segments)
    """

    segments: IntArray
    lengths: IntArray | None = None
    place: FloatArray | None = None
    turn: float = 0.0

    def __post_init__(self) -> None:
        segments = as_indices("segments", self.segments, ("n",)).copy()
        if not len(segments):
            raise ValueError("`segments` must contain at least one segment, got none")
        arrays: dict[str, FloatArray | IntArray] = {"segments": segments}
        turn = float(as_floats("turn", self.turn, ()))
        if self.lengths is not None:
            lengths = as_indices("lengths", self.lengths, (len(segments),)).copy()
            if (lengths < 1).any():
                raise ValueError(f"`lengths` must be at least 1, got {lengths.min()}")
            arrays["lengths"] = lengths
        if self.place is not None:
            arrays["place"] = as_floats("place", self.place, (3,)).copy()
        object.__setattr__(self, "turn", turn)
        for name, array in arrays.items():
            make_read_only(array)
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        return f"Scenario({len(self.segments)} segments)"
