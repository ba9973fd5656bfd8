"""Fixtures of the command line: clips, an empty working folder, and usage errors."""

import os
from dataclasses import replace
from functools import partial

import pytest

from mograft import write_bvh
from mograft.dancer import dance


@pytest.fixture(autouse=True)
def working_folder(tmp_path, monkeypatch):
    """Change to an empty folder, and remove all settings from the environment."""
    for name in [name for name in os.environ if name.startswith("MOGRAFT_")]:
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="package")
def folder(tmp_path_factory):
    """A folder of two clips, a.bvh of 600 frames and b.bvh."""
    folder = tmp_path_factory.mktemp("clips")
    motion = dance(seed=1, strides=1).motion
    write_bvh(motion[:600], folder / "a.bvh")
    write_bvh(motion[600:], folder / "b.bvh")
    return folder


@pytest.fixture(scope="package")
def clip(tmp_path_factory):
    """A BVH file of 400 frames."""
    path = tmp_path_factory.mktemp("clip") / "a.bvh"
    write_bvh(dance(seed=1, strides=1).motion[:400], path)
    return path


@pytest.fixture(scope="package")
def folder_of_many_clips(tmp_path_factory):
    """A folder of 3,000 links to a BVH file of 1,491 frames, whose ingest takes minutes.

    A command that reads them is certainly still busy when a test sends it a signal, even if the
    test itself is not scheduled for half a minute.
    """
    folder = tmp_path_factory.mktemp("many")
    motion = dance(seed=1, strides=1).motion
    write_bvh(motion, folder.with_suffix(".bvh"))
    for number in range(3_000):
        os.link(folder.with_suffix(".bvh"), folder / f"c{number}.bvh")
    return folder


@pytest.fixture(scope="package")
def slow_clip(tmp_path_factory):
    """A BVH file of 25 minutes, whose films take minutes at 50 and more pictures per second."""
    path = tmp_path_factory.mktemp("slow") / "slow.bvh"
    write_bvh(replace(dance(seed=1, strides=1).motion, frame_time=1.0), path)
    return path


@pytest.fixture
def usage_error(fail):
    """Run a command that must end with a usage error; return stderr."""
    return partial(fail, 2)
