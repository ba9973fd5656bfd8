"""Compute the power of the study with people, with simulated participants."""

from pathlib import Path

from lab.experiments.tables import Table
from lab.pairs import analysis, raters
from lab.pairs.excerpts import N_PAIRS

NAME = "pairs"
CODE = tuple(Path(own.__file__) for own in (analysis, raters))
SHARES = (0.5, 0.55, 0.6, 0.65, 0.7, 0.75)
PEOPLE = (12, 24, 48)


def find_inputs(_data, _unpacked):
    """Return no files: participants are simulated."""
    return []


def read_inputs(_data, _unpacked, *, is_quick):
    """Return the number of simulated studies."""
    return 20 if is_quick else 400


def power(n_studies):
    """Return the share of studies that find a preference, by its size and the participants."""
    head = ("preference for the graft", *(f"power, {n} participants" for n in PEOPLE))
    rows = [
        (f"{own:g}", *(f"{raters.power(own, n, N_PAIRS, n_studies=n_studies):.2f}" for n in PEOPLE))
        for own in SHARES
    ]
    return Table(head, rows)


PARTS = {"power": power}
