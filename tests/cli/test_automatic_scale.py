"""``--set sigma_scale=auto`` and ``mograft plot threshold``."""

import json

import pytest

from mograft import Config, Library


def test_automatic_scale_of_commands_is_that_of_python(run, folder, tmp_path):
    expected = Library.build(folder / "a.bvh", config=Config(sigma_scale="auto"))
    options = ["--set", "sigma_scale=auto"]
    code, out, _ = run("index", folder / "a.bvh", "-o", tmp_path / "lib", "--json", *options)
    assert code == 0
    groups = json.loads(out)["groups"]
    assert {name: own["sigma_scale"] for name, own in groups.items()} == expected.sigma_scales
    assert {name: own["sigma"] for name, own in groups.items()} == expected.sigma
    scale = expected.sigma_scales["lower"]
    assert f"(sigma_scale auto: {scale:.3g})" in run("lib", "info", tmp_path / "lib")[1]


def test_graft_with_automatic_scale_is_created_again_from_its_record(run, folder, tmp_path):
    first, second = tmp_path / "x.bvh", tmp_path / "y.bvh"
    assert run("graft", folder / "a.bvh", "--set", "sigma_scale=auto", "-o", first)[0] == 0
    assert run("graft", "--from", tmp_path / "x.json", "-o", second)[0] == 0
    assert first.read_bytes() == second.read_bytes()


def test_automatic_scale_other_word_is_usage_error(usage_error, folder, tmp_path):
    message = usage_error(
        "graft", folder / "a.bvh", "--set", "sigma_scale=big", "-o", tmp_path / "x"
    )
    assert "--set: `sigma_scale` must be a number above 0 or 'auto', got 'big'" in message


def test_plot_threshold_draws_curve_and_both_scales(run, folder, tmp_path):
    pyplot = pytest.importorskip("matplotlib.pyplot", reason="matplotlib is not installed")
    from mograft.analysis.scale_choice import scale_curve
    from mograft.viewing import plot

    library = Library.build(folder / "a.bvh")
    curve = scale_curve(library.embedding, "upper", library.config)
    axes = plot.threshold(library, "upper")
    lines = {line.get_label(): line for line in axes.lines}
    assert lines["within clusters"].get_ydata() == pytest.approx(curve.errors, nan_ok=True)
    assert lines["limit"].get_ydata()[0] == pytest.approx(1.1 * curve.repetition_error)
    assert lines[f"auto: {curve.scale:.2f}"].get_xdata()[0] == curve.scale
    assert lines["library: 0.75"].get_xdata()[0] == 0.75
    pyplot.close("all")
    words = ["plot", "threshold", folder / "a.bvh", "--group", "upper", "-o", tmp_path / "x.png"]
    assert run(*words)[0] == 0
    cuts = {"a": range(60, 600, 60)}
    few = Library.build(library.clips[0], config=Config(segmentation=cuts))
    with pytest.raises(ValueError, match=r"needs at least 20 segments .* has 10 segments"):
        plot.threshold(few)
