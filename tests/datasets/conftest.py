"""Libraries from which the tests make data sets."""

from dataclasses import replace

import pytest

import mograft as mg
from mograft.dancer import dance


@pytest.fixture(scope="session")
def takes():
    """Six takes of three performers, 240 frames each."""
    whole = [dance(seed=seed, strides=1).motion for seed in range(3)]
    return [
        replace(motion[start : start + 240], name=f"p{number}_{start}", path=None)
        for number, motion in enumerate(whole)
        for start in (100, 700)
    ]


@pytest.fixture(scope="session")
def clip_folder(takes, tmp_path_factory):
    """The takes as files, in a folder for each performer."""
    folder = tmp_path_factory.mktemp("takes")
    for take in takes:
        (folder / take.name[:2]).mkdir(exist_ok=True)
        mg.write_bvh(take, folder / take.name[:2] / f"{take.name}.bvh")
    return folder


@pytest.fixture(scope="session")
def stored(clip_folder, tmp_path_factory):
    """The takes, indexed in a folder."""
    return mg.Library.index(clip_folder, tmp_path_factory.mktemp("library") / "takes.mograft")
