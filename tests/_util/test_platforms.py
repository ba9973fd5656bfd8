"""Names that every platform accepts, and the code for Windows run here: positions, links."""

import errno
import os
import re
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import mograft as mg
from mograft._util import atomic
from mograft._util.names import portable_stem
from mograft.dancer import dance
from mograft.library.files import array_files, generation

DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d|conin\$|conout\$)", re.IGNORECASE)
names = st.text(max_size=300) | st.from_regex(r"(?i)(con|nul|lpt1|walk)[ .]?[a-z.: ]{0,4}")


def is_portable(name):
    """Return whether Windows, with the strictest rules, accepts a name."""
    return (
        bool(name)
        and len(name.encode("utf-8", "surrogateescape")) <= 255
        and not re.search(r'[<>:"/\\|?*\x00-\x1f]', name)
        and name[-1] not in " ."
        and not DEVICE.fullmatch(name.partition(".")[0].rstrip())
    )


@given(names)
@example("CON")
@example("con .bvh")
@example("a.")
@example("")
@example("\udcff")
@example("\ud800")
@example("ä" * 200)
@example("a" * 219 + ". b")
def test_portable_stem_any_text_gives_name_that_windows_accepts(name):
    stem = portable_stem(name)
    assert is_portable(stem)
    assert is_portable(stem + "_graft0.bvh")
    assert portable_stem(stem) == stem


@given(st.from_regex(r"[\w][\w \-.~()#]{0,40}\w", fullmatch=True))
def test_portable_stem_accepted_name_is_unchanged(name):
    if is_portable(name) and len(name.encode()) <= 220:
        assert portable_stem(name) == name


not_on_windows = pytest.mark.skipif(sys.platform == "win32", reason="replaces modules of Windows")


class WindowsOs(types.ModuleType):
    """The module ``os`` as on Windows: no positioned reads, and here no links, too."""

    def __init__(self):
        super().__init__("os")
        self.name = "nt"

    def __getattr__(self, name):
        if name in {"preadv", "pread", "O_CLOEXEC", "fork", "kill"}:
            raise AttributeError(f"module 'os' has no attribute '{name}'")
        return getattr(os, name)

    def link(self, *paths):
        raise OSError(errno.EPERM, "the file system has no links", *paths)


@not_on_windows
def test_library_written_and_read_as_on_windows_has_same_bytes(tmp_path, monkeypatch):
    clips = [tmp_path / "a.bvh", tmp_path / "b.bvh"]
    for seed, clip in enumerate(clips):
        mg.write_bvh(dance(seed=seed, strides=1).motion[:300], clip)

    def write(folder):
        mg.Library.index(clips[:1], folder)
        library = mg.Library.open(folder).add(clips[1:])
        files = sorted(path for path in folder.rglob("*.npy"))
        contents = {path.relative_to(folder): path.read_bytes() for path in files}
        return contents, mg.graft(library, seed=3).motion.rotations

    expected, rotations = write(tmp_path / "here")
    for module in (array_files, atomic, generation):
        monkeypatch.setattr(module, "os", WindowsOs())
    found, windows_rotations = write(tmp_path / "windows")
    assert found == expected
    np.testing.assert_array_equal(windows_rotations, rotations)


def test_files_of_library_have_portable_names_for_any_clip_and_group(tmp_path):
    motion = dance(strides=1).motion[:300]
    names = ["CON", "con", "a:b", "A:B", "ends.", "..", "x/y", "nul.bvh"]
    groups = mg.JointGroups.preset("lower_upper", motion.skeleton)
    renamed = {"CON": groups.groups["lower"], "con": groups.groups["upper"]}
    groups = mg.JointGroups(renamed, base="CON")
    clips = [replace(motion, name=name) for name in names]
    mg.Library.build(clips, groups=groups).save(tmp_path / "l")
    library = mg.Library.open(tmp_path / "l")
    assert [entry.name for entry in library.entries] == names
    assert set(library.labels) >= {"CON"}
    paths = [path.relative_to(tmp_path).as_posix() for path in (tmp_path / "l").rglob("*")]
    assert len({path.casefold() for path in paths}) == len(paths)
    for path in paths:
        assert all(map(is_portable, path.split("/"))), path
        assert re.fullmatch(r"[a-z0-9_./-]+", path), path


@pytest.mark.parametrize("clip", ["CON", "a:b", "x/y", "ends.", "t\nb"])
def test_grafts_of_clip_with_unusable_name_have_portable_file_names(tmp_path, monkeypatch, clip):
    from mograft.cli import main

    monkeypatch.chdir(tmp_path)
    mg.Library.build([replace(dance(strides=1).motion[:300], name=clip)]).save(Path("l"))
    assert main(["graft", "l", "-o", "out"]) == 0
    written = [path.name for path in Path("out").iterdir()]
    assert len(written) == 2
    assert all(map(is_portable, written))
