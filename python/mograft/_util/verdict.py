"""How a number compares with a range, in words: the one rule of all commands and pages."""

import numpy as np

from mograft._util.arrays import FloatArray


def compare(value: float, low: float, high: float, digits: str = ".2f") -> str:
    """Return whether a value is within a range, and the range, as text.

    >>> compare(1.87, 0.9, 1.3, ".1f")
    'above 0.9 to 1.3'
    """
    verdict = "below" if value < low else "above" if value > high else "within"
    return f"{verdict} {low:{digits}} to {high:{digits}}"


def compare_with_most(value: float, steps: FloatArray) -> str:
    """Return how a value compares with the middle 90 % of those of all steps of a recording."""
    low, high = np.percentile(steps, (5.0, 95.0))
    return f"{compare(value, low, high, '.1f')} of the recording"
