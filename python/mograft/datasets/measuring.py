"""Measure whether classifiers distinguish the grafts of a data set from captured motion."""

import csv
from os import PathLike, fspath
from pathlib import Path

import numpy as np

from mograft._util.validate import check_type
from mograft.datasets.augmentation import Augmentation
from mograft.datasets.writing import TABLE
from mograft.evaluation.detectability import Detectability, detectability
from mograft.io.csv import without_formula

_MAX_GRAFTS = 64  # that are built again; their seams give more windows than are compared


def measure(windows: Augmentation, folder: str | PathLike[str]) -> Detectability:
    """Measure whether classifiers distinguish the grafts of a data set from captured motion.

    Parameters
    ----------
    windows : Augmentation
        The windows that `write` has written.
    folder : path
        The folder of the data set.

    Returns
    -------
    Detectability
        The measures of `mograft.evaluation.detectability`, with intervals. They are those of 64 of
        the grafts at most, at equal intervals in the data set.

    Raises
    ------
    FileNotFoundError
        If the data set is not complete.
    ImportError
        If scikit-learn is not installed.
    InsufficientDataError
        If the grafts have too few seams.
    """
    check_type("windows", windows, Augmentation)
    with (Path(fspath(folder)) / TABLE).open(encoding="utf-8", newline="") as stream:
        found = dict.fromkeys((row["base"], int(row["draw"])) for row in csv.DictReader(stream))
    every = list(found)
    rows = np.unique(np.linspace(0, len(every) - 1, min(len(every), _MAX_GRAFTS)).round())
    draws: dict[str, list[int]] = {}
    for row in rows.astype(int).tolist():
        draws.setdefault(every[row][0], []).append(every[row][1])
    names = windows.library.names
    bases = {without_formula(names[base]): base for base in windows.bases.tolist()}
    grafts = [
        windows.build(bases[name], sorted(own)) for name, own in draws.items() if name in bases
    ]
    return detectability("data set", grafts, windows.seed)
