"""Laws of memory: what does not fit is refused by name."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
from mograft._util import memory
from mograft.cli import main
from mograft.dancer import dance
from mograft.synthesis.graft import MEMORY_FACTOR


@given(st.integers(0, 1 << 40), st.integers(0, 1 << 40))
def test_check_memory_refuses_exactly_what_is_large_and_does_not_fit(n_bytes, available):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory._core, "available_memory", lambda: available)
        if n_bytes > available and n_bytes > 1 << 28:
            with pytest.raises(mg.MemoryBudgetError, match=r"work needs about .* available: less"):
                memory.check_memory("work", n_bytes, "less")
        else:
            memory.check_memory("work", n_bytes, "less")


def test_graft_that_does_not_fit_is_refused_by_name(monkeypatch, tmp_path, capsys):
    motion = dance(strides=1).motion
    library = mg.Library.build(motion)
    n_numbers = motion.rotations.size + motion.positions.size + motion.channel_numbers().size
    needed = MEMORY_FACTOR * 8 * n_numbers
    monkeypatch.setattr(memory, "_MAX_UNCHECKED_BYTES", 0)
    monkeypatch.setattr(memory._core, "available_memory", lambda: needed)
    mg.graft(library)
    monkeypatch.setattr(memory._core, "available_memory", lambda: needed - 1)
    message = rf"a graft on dance with {motion.n_frames} frames needs about 0\.\d GB"
    for base in (None, "dance", motion):
        with pytest.raises(mg.MemoryBudgetError, match=message) as caught:
            mg.graft(library, base)
        assert isinstance(caught.value, MemoryError)
    mg.write_bvh(motion, tmp_path / "dance.bvh")
    assert main(["graft", str(tmp_path / "dance.bvh"), "-o", str(tmp_path / "new.bvh")]) == 1
    assert "GB of memory" in capsys.readouterr().err
