"""`mograft completion`: the scripts that shells read."""

import shutil
import subprocess
import sys

import pytest

from mograft.cli import COMMANDS

SHELLS = {
    "bash": "source {script}; COMP_WORDS=({words}); COMP_CWORD={at}; "
    "COMP_LINE='{line}'; COMP_POINT=${{#COMP_LINE}}; _shtab_mograft; "
    'printf "%s\\n" "${{COMPREPLY[@]}}"',
    "fish": "source {script}; complete -C '{line}'",
}


@pytest.mark.parametrize("shell", sorted(SHELLS))
@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("mograft gr", {"graft", "groups"}),
        ("mograft graft --vari", {"--variety"}),
        ("mograft graft --set tor", {"torso=world", "torso=pelvis"}),
        ("mograft lib ve", {"verify"}),
        ("mograft graft --preset p", {"paper"}),
    ],
)
def test_completion_shells_complete_commands_options_and_choices(
    run, working_folder, shell, line, wanted
):
    pytest.importorskip("shtab", reason="shtab is not installed")
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    (working_folder / "script").write_text(run("completion", shell)[1])
    words = line.split(" ")
    code = SHELLS[shell].format(
        script=working_folder / "script", words=" ".join(words), at=len(words) - 1, line=line
    )
    completed = subprocess.run([shell, "-c", code], capture_output=True, text=True, check=False)
    # fish appends a description to each word.
    found = {line.split("\t")[0] for line in completed.stdout.split("\n") if line}
    assert wanted <= found, completed.stderr
    assert all(word.startswith(words[-1]) for word in found)


def test_completion_scripts_name_commands(run):
    pytest.importorskip("shtab", reason="shtab is not installed")
    for shell in ("bash", "zsh", "fish", "tcsh"):
        text = run("completion", shell)[1]
        for command in COMMANDS:
            assert command.name in text, (shell, command.name)


def test_completion_missing_shtab_names_extra(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "shtab", None)
    code, out, err = run("completion", "bash")
    assert (code, out) == (1, "")
    assert "pip install 'mograft[completion]'" in err
