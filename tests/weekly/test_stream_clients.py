"""The C++ and C# clients of `mograft stream` in examples compile, and receive its frames."""

import shutil
import subprocess

import numpy as np
import pytest

import mograft as mg
from mograft.stream.server import StreamServer
from tests.stream_examples import EXAMPLES

_PROJECT = """<Project Sdk="Microsoft.NET.Sdk"><PropertyGroup><OutputType>Exe</OutputType>
<TargetFramework>net8.0</TargetFramework></PropertyGroup></Project>"""


def run(*words, **options):
    """Run a program that must succeed, and return its output."""
    options = {"capture_output": True, "text": True, "timeout": 300, **options}
    process = subprocess.run(list(map(str, words)), **options)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def compile_cpp(folder):
    """Compile the C++ client; return the words that run it."""
    compiler = next(filter(shutil.which, ("c++", "g++", "clang++")), None)
    if compiler is None:
        pytest.skip("no C++ compiler: c++, g++ or clang++")
    source, program = EXAMPLES / "stream_client.cpp", folder / "stream_client"
    warnings = ("-Wall", "-Wextra", "-Wconversion", "-Werror")
    run(compiler, "-std=c++17", *warnings, source, "-o", program)
    return [program]


def compile_csharp(folder):
    """Compile the C# client; return the words that run it."""
    source = EXAMPLES / "StreamClient.cs"
    if shutil.which("mcs") and shutil.which("mono"):
        run("mcs", "-warnaserror", source, f"-out:{folder / 'StreamClient.exe'}")
        return ["mono", folder / "StreamClient.exe"]
    if shutil.which("dotnet"):
        shutil.copy(source, folder)
        (folder / "StreamClient.csproj").write_text(_PROJECT, encoding="utf-8")
        run("dotnet", "build", "-o", folder / "out", cwd=folder)
        return ["dotnet", folder / "out" / "StreamClient.dll"]
    pytest.skip("no C# compiler: mcs with mono, or dotnet")


@pytest.mark.parametrize("compile_client", [compile_cpp, compile_csharp])
def test_example_client_receives_the_frames_of_a_stream(
    two_dances, short_base, tmp_path, compile_client
):
    words = compile_client(tmp_path)
    n_frames = short_base.n_frames
    rotations = short_base.rotations.astype("<f4")
    positions = short_base.positions[:, two_dances.root].astype("<f4")
    rows = np.concatenate([rotations.reshape(n_frames, -1), positions], axis=1)
    rows.tofile(tmp_path / "frames")
    with StreamServer(two_dances) as server:
        printed = run(*words, server.port, tmp_path / "frames", tmp_path / "output")
    assert printed == f"{n_frames} frames\n"
    quats = rotations.astype(float)
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    stream = mg.Stream(two_dances, seed=7, horizon=4)
    stream.push(quats, positions)
    stream.close()
    pieces = stream.pieces()
    motion = mg.join_pieces(pieces)
    received = np.fromfile(tmp_path / "output", "<f4").reshape(n_frames, -1)
    expected = [motion.rotations, motion.positions]
    expected = np.concatenate([own.astype("<f4").reshape(n_frames, -1) for own in expected], axis=1)
    np.testing.assert_array_equal(received, expected)
    assert any(not own.is_own for piece in pieces for own in piece.substitutions)
