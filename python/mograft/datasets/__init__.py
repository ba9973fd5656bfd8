"""Data sets of grafts for the training of models, and searches in libraries.

`augment` returns windows of grafts as a sequence, `write` stores them in a folder, and `read_set`
opens it. Bases and donors of one part of a split hold no motion of another part. `find` returns
spans that move like a query, `curate` few clips that hold nearly all movements of a library.
"""

from mograft.datasets.augmentation import Augmentation, augment
from mograft.datasets.curation import Choice, Curation, curate
from mograft.datasets.curation_files import curation_page, write_choice
from mograft.datasets.features import FEATURES
from mograft.datasets.finding import Hit, find
from mograft.datasets.humanml import humanml3d
from mograft.datasets.measuring import measure
from mograft.datasets.reading import DataSet, read_set
from mograft.datasets.writing import write

__all__ = [
    "FEATURES",
    "Augmentation",
    "Choice",
    "Curation",
    "DataSet",
    "Hit",
    "augment",
    "curate",
    "curation_page",
    "find",
    "humanml3d",
    "measure",
    "read_set",
    "write",
    "write_choice",
]
