"""Properties of atomic writes and locks: kills, errors, links, permissions, long names."""

import os
import subprocess
import sys
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft._util.atomic import atomic_folder, atomic_path, exclusive_lock, write_bytes, write_text

KILLED_SCRIPT = """
import os, signal, sys
from pathlib import Path
from mograft._util.atomic import atomic_path
for name in sys.argv[2:]:
    with atomic_path(Path(sys.argv[1], name)) as draft:
        draft.write_text("half")
        if name == sys.argv[-1]:
            os.kill(os.getpid(), signal.SIGKILL)
"""


def list_names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_atomic_path_killed_process_draft_is_removed_by_next_write(tmp_path):
    command = [sys.executable, "-c", KILLED_SCRIPT, str(tmp_path), "old.bvh", "a.bvh"]
    subprocess.run(command, check=False)
    drafts = [name for name in list_names(tmp_path) if name != "old.bvh"]
    assert len(drafts) == 1
    assert drafts[0].startswith(".")
    assert drafts[0].endswith(".part")
    write_text(tmp_path / "b.bvh", "other")
    assert drafts[0] in list_names(tmp_path)  # only the writer of a target removes its drafts
    write_text(tmp_path / "a.bvh", "whole")
    assert list_names(tmp_path) == ["a.bvh", "b.bvh", "old.bvh"]
    assert (tmp_path / "a.bvh").read_text() == "whole"


def test_atomic_path_draft_of_running_process_is_kept(tmp_path):
    target = tmp_path / "a.bvh"
    with atomic_path(target) as draft:
        draft.write_text("first")
        other = threading.Thread(target=write_text, args=(target, "second"))
        other.start()
        other.join()
        assert target.read_text() == "second"
        script = "import sys; from pathlib import Path; from mograft._util.atomic import write_text"
        command = [sys.executable, "-c", f"{script}; write_text(Path(sys.argv[1]), 'third')"]
        subprocess.run([*command, str(target)], check=True)
        assert target.read_text() == "third"
    assert target.read_text() == "first"
    assert list_names(tmp_path) == ["a.bvh"]


def test_atomic_path_error_keeps_old_file(tmp_path):
    target = tmp_path / "a.bvh"
    write_text(target, "old")

    def write_and_fail():
        with atomic_path(target) as draft:
            draft.write_text("new")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_and_fail()
    assert list_names(tmp_path) == ["a.bvh"]
    assert target.read_text() == "old"


def test_atomic_folder_appears_whole_or_not_at_all(tmp_path):
    target = tmp_path / "new"

    def write(name, *, fails):
        with atomic_folder(target) as draft:
            (draft / name).write_text("")
            if fails:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write("half", fails=True)
    assert list_names(tmp_path) == []
    write("whole", fails=False)
    with pytest.raises(OSError, match="new"):  # it has a file
        write("other", fails=False)
    assert list_names(tmp_path) == ["new"]
    assert list_names(target) == ["whole"]


def test_atomic_path_dangling_link_is_refused(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    link = tmp_path / "a.bvh"
    link.symlink_to(tmp_path / "elsewhere" / "b.bvh")
    with pytest.raises(FileExistsError, match="link to a missing file"):
        write_text(link, "text")
    assert list_names(tmp_path / "elsewhere") == []
    assert link.is_symlink()


@pytest.mark.skipif(sys.platform == "win32", reason="needs the permissions of POSIX")
@given(st.sampled_from([0o600, 0o640, 0o644, 0o664, 0o755]))
def test_atomic_path_keeps_permissions(tmp_path_factory, mode):
    target = tmp_path_factory.mktemp("mode") / "a.bvh"
    target.write_text("old")
    target.chmod(mode)
    write_text(target, "new")
    assert target.stat().st_mode & 0o777 == mode
    before = os.umask(0o027)
    try:
        write_text(target.with_name("new.bvh"), "new")
    finally:
        os.umask(before)
    assert target.with_name("new.bvh").stat().st_mode & 0o777 == 0o640


@pytest.mark.skipif(sys.platform == "win32", reason="paths of Windows are shorter")
@given(st.integers(1, 251), st.binary(max_size=9))
def test_write_bytes_name_of_any_length_is_written(tmp_path_factory, length, data):
    target = tmp_path_factory.mktemp("long") / f"{'n' * length}.bvh"
    write_bytes(target, data)
    assert target.read_bytes() == data
    assert list_names(target.parent) == [target.name]


HOLD_SCRIPT = """
import sys
from pathlib import Path
from mograft._util.atomic import exclusive_lock
with exclusive_lock(Path(sys.argv[1])):
    print("locked", flush=True)
    sys.stdin.read()
"""


def test_exclusive_lock_held_by_other_process_raises_until_it_ends(tmp_path):
    path = tmp_path / ".lock"
    command = [sys.executable, "-c", HOLD_SCRIPT, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline().strip() == b"locked"
        with pytest.raises(BlockingIOError), exclusive_lock(path):
            pass
        process.kill()
    with exclusive_lock(path):
        pass
    assert path.read_bytes() == b""
