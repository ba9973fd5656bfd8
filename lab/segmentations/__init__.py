"""Methods of segmentation beside those of the product, as functions for `Config(segmentation=...)`.

``mg.segment(motion, method=method("pca"))`` cuts a motion; ``mg.Config(segmentation=method("com",
min_depth=0.02))`` all clips of a library. A method is a module with `cut_frames`.
"""

import numpy as np

import mograft as mg
from lab.segmentations import beats, com, contacts, gmm, pca, ppca
from mograft.analysis.segmentation import merge_short_segments, split_long_segments

METHODS = {
    "beats": (beats, beats.BeatParameters),
    "com": (com, com.ComParameters),
    "contacts": (contacts, contacts.ContactParameters),
    "pca": (pca, pca.PcaParameters),
    "ppca": (ppca, ppca.PpcaParameters),
    "gmm": (gmm, gmm.GmmParameters),
}
WHOLE_BEHAVIOURS = ("pca", "ppca", "gmm")  # whose segments may be longer than `max_length`


def method(name, config=None, **parameters):
    """Return the function that maps a motion to the cut frames of a method.

    As in `mograft.segment`, segments shorter than `Config.min_length` are merged, and segments
    longer than `Config.max_length` are split, except whole behaviours.
    """
    module, kind = METHODS[name]
    given, config = kind(**parameters), config or mg.Config()

    def cut(motion):
        bounds = [0, *module.cut_frames(motion, given), motion.n_frames - 1]
        shortest = max(round(config.min_length * motion.rate), 1)
        bounds = merge_short_segments(np.array(bounds), mg.kinetic_energy(motion), shortest)
        if name not in WHOLE_BEHAVIOURS:
            bounds = split_long_segments(bounds, config.max_length * motion.rate)
        return bounds[1:-1]

    return cut
