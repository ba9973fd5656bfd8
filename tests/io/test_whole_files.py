"""A file that was written incompletely is noticed, and the file at its place is kept."""

import os
from contextlib import contextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util import atomic
from mograft._util.atomic import checked_path
from mograft.dancer import dance
from mograft.io import usd
from mograft.library import export
from mograft.viewing import video
from tests.strategies import few_examples

MOTION = dance(strides=1).motion[:40]


@contextmanager
def truncated_files(module, share):
    """Truncate each file that a library has written, before it is checked."""

    @contextmanager
    def damaging(target, is_whole):
        def check(draft):
            os.truncate(draft, int(share * draft.stat().st_size))
            return is_whole(draft)

        with checked_path(target, check) as draft:
            yield draft

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "checked_path", damaging)
        yield


def _film(path):
    pytest.importorskip("PIL")
    if path.suffix == ".mp4":
        pytest.importorskip("imageio_ffmpeg")
    video.write_video(MOTION, path, size=(64, 64))


def _usd(path):
    pytest.importorskip("pxr")
    usd.write_usd(MOTION, path)


def _parquet(path):
    pytest.importorskip("pyarrow")
    export._write_parquet(path, {"number": list(range(1000))})


WRITERS = {
    "a.gif": (atomic, _film),
    "a.glb": (atomic, lambda path: mg.write(MOTION, path, force=True)),
    "a.mp4": (video, _film),
    "a.parquet": (export, _parquet),
    "a.usda": (usd, _usd),
    "a.usdc": (usd, _usd),
}


@pytest.mark.parametrize("name", WRITERS)
@few_examples(5)
@given(share=st.floats(0.0, 0.999))
def test_write_truncated_file_raises_oserror_and_keeps_the_old_file(tmp_path_factory, name, share):
    folder = tmp_path_factory.mktemp("whole")
    module, write = WRITERS[name]
    target = folder / name
    write(target)
    old = target.read_bytes()
    with truncated_files(module, share), pytest.raises(OSError, match=r"incompletely.*/a\."):
        write(target)
    assert [path.name for path in folder.iterdir()] == [name]
    assert target.read_bytes() == old


def test_write_usd_full_disk_raises_one_line(tmp_path):
    pytest.importorskip("pxr")
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limits[1]))
        with pytest.raises(OSError, match="writing file: File too large") as caught:
            usd.write_usd(MOTION, tmp_path / "a.usdc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "pxr" not in str(caught.value)
