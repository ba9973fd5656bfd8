"""The zero-moment point: where the reaction of the floor acts on a body."""

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray

GRAVITY = 9.81  # m/s²
STATURE_METERS = 1.75  # assumed stature, to convert gravity to the unit of a file
_MIN_LOAD = 0.2  # share of gravity that the floor must carry for a zero-moment point to exist


def zero_moment_points(
    position: FloatArray, acceleration: FloatArray, up: FloatArray, floor: float, height: float
) -> tuple[FloatArray, BoolArray]:
    """Return the zero-moment point of a point mass in each frame, and whether it exists.

    The point is x - (z - floor) ẍ / (z̈ + g) along each horizontal axis, with the coordinate x and
    the height z of the centre of mass (Vukobratović and Borovac, International Journal of Humanoid
    Robotics 1, 2004). `position` and `acceleration`, shape (n_frames, 3), are those of the centre
    of mass. `up` is a unit vector, `floor` the height of the floor along `up`, and `height` the
    skeleton height. Lengths are in the unit of the file, times in seconds. The point does not
    exist, and `position` is returned, if the floor carries less than a fifth of the weight.
    """
    gravity = GRAVITY * height / STATURE_METERS
    load = acceleration @ up + gravity
    is_loaded: BoolArray = load > _MIN_LOAD * gravity
    lever = (position @ up - floor) / np.where(is_loaded, load, np.inf)
    points: FloatArray = position - lever[:, None] * acceleration
    return points, is_loaded
