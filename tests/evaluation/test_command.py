"""The command `mograft evaluate`."""

import json

import pytest

from mograft import Library, read_bvh, write_bvh
from mograft.cli import main
from mograft.evaluation import estimate

pytest.importorskip("sklearn", reason="scikit-learn is not installed")


@pytest.fixture
def files(tmp_path, small_library):
    paths = [tmp_path / f"{clip.name}.bvh" for clip in small_library.clips[:2]]
    for clip, path in zip(small_library.clips, paths, strict=False):
        write_bvh(clip, path)
    return [str(path) for path in paths]


def test_command_with_output_writes_document_and_page(files, tmp_path, capsys):
    out = tmp_path / "report"
    command = ["evaluate", *files, "quality", "balance", "--runs", "1", "--bases", "1"]
    assert main([*command, "-o", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.out.split() == [str(out / "evaluation.json"), str(out / "index.html")]
    assert "are exchanged" in printed.err
    document = json.loads((out / "evaluation.json").read_text())
    assert {"quality", "balance"} <= document.keys()
    assert "world" not in document
    counts = ["evaluate", *files, "balance", "--runs", "1"]
    assert main([*counts, "-o", str(out)]) == 1
    assert "use --force to overwrite" in capsys.readouterr().err
    assert json.loads((out / "evaluation.json").read_text()) == document
    written = []
    for _ in range(2):
        assert main([*counts, "-o", str(out), "--force"]) == 0
        written.append([path.read_bytes() for path in sorted(out.iterdir())])
    assert written[0] == written[1]
    capsys.readouterr()
    assert main([*counts, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(written[0][0])


def test_command_library_prints_same_document_as_files(files, tmp_path, capsys):
    Library.index(files, tmp_path / "lib")
    options = ["quality", "balance", "--runs", "1", "--bases", "1", "--json"]
    documents = []
    for inputs in (files, [str(tmp_path / "lib")]):
        assert main(["evaluate", *inputs, *options]) == 0
        documents.append(json.loads(capsys.readouterr().out))
    assert documents[0] == documents[1]
    for option in (["--rate", "15"], ["--groups", "lower_upper"], ["--preset", "paper"]):
        with pytest.raises(SystemExit, match="2"):
            main(["evaluate", str(tmp_path / "lib"), *option])
        assert "is fixed when a library is created" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["balance"], 2, "expected one library or at least one motion file"),
        (["FILE", "--rate", "0"], 2, "--rate: must be a number above 0"),
        (["FILE", "--runs", "0"], 2, "--runs: must be an integer of at least 1"),
        (["missing.bvh"], 1, "missing.bvh"),
        (["FILE", "--groups", "wings"], 2, "wings"),
    ],
)
def test_command_invalid_arguments_exit_with_message(files, capsys, words, code, message):
    arguments = ["evaluate", *(files[0] if word == "FILE" else word for word in words)]
    try:
        exit_code = main(arguments)
    except SystemExit as error:
        exit_code = error.code
    assert exit_code == code
    assert message in capsys.readouterr().err


def test_command_file_named_like_topic_is_read_as_file(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_bvh(read_bvh(files[0]), tmp_path / "quality")
    assert main(["evaluate", "quality", "balance", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert "quality" not in document
    assert document["library"]["segments"] > 0


def test_command_missing_package_names_extra(files, monkeypatch, capsys):
    def raise_import_error(name):
        raise ImportError(name, name=name)

    monkeypatch.setattr(estimate, "import_module", raise_import_error)
    assert main(["evaluate", "world", *files, "--runs", "1", "--json"]) == 1
    assert "SciPy: pip install 'mograft[evaluate]'" in capsys.readouterr().err
