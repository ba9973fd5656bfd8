"""``mograft evaluate``: measures of a library and of its grafts."""

import argparse
import json
from importlib.util import find_spec
from pathlib import Path

from mograft._util.atomic import write_text
from mograft.cli.configuration import load_library, options_given
from mograft.cli.files import check_suffix, check_writable
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.command_table import EVALUATION_TOPICS, LABEL
from mograft.errors import suggest_name
from mograft.evaluation import evaluate, label_items, label_page, read_labels
from mograft.viewing.evaluation_report import evaluation_page, summarize

_WORDS = (*EVALUATION_TOPICS, "all", LABEL)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    words = _take_words(options)
    if LABEL in words:
        if len(words) > 1:
            options.usage_error(f"{LABEL} cannot be combined with {', '.join(_WORDS[:-1])}")
        return _write_label_page(options)
    if options_given(options, "labels") and words and not {"naturalness", "all"} & set(words):
        options.usage_error("--labels requires naturalness among the words that select measures")
    folder: Path | None = options.output
    if folder is not None:
        check_suffix(options, is_folder=True)
    paths = [] if folder is None else [folder / "evaluation.json", folder / "index.html"]
    check_writable(paths, force=options.force)
    if folder is not None and find_spec("matplotlib") is None:
        raise ValueError(
            "-o writes a page, which needs matplotlib: pip install 'mograft[evaluate]'"
        )
    library = load_library(options)
    labels = None if options.labels is None else read_labels(options.labels, library)
    with show_progress() as progress:
        found = evaluate(
            library,
            EVALUATION_TOPICS if not words or "all" in words else words,
            runs=options.runs,
            bases=options.bases,
            labels=labels,
            seed=options.seed or 0,
            progress=progress,
        )
    document = found.as_dict()
    if folder is not None:
        page = evaluation_page(found)
        folder.mkdir(parents=True, exist_ok=True)
        write_text(paths[0], json.dumps(document, indent=1, allow_nan=False) + "\n")
        page.save(paths[1], force=True)
    if not options.json:
        for sentence in summarize(found):
            print_remark(sentence)
        if folder is None:
            print_remark("use -o DIR to write all numbers and a page to a folder")
    print_result(options, "evaluation", document, paths)
    return 0


def _take_words(options: argparse.Namespace) -> tuple[str, ...]:
    """Remove the words that select what to measure from ``options.files``, and return them."""
    names: list[str] = options.files
    words = [name for name in names if name in _WORDS and not Path(name).exists()]
    options.files = [name for name in names if name not in words]
    if not options.files:
        options.usage_error("expected one library or at least one motion file, got none")
    for name in options.files:
        if name.isalpha() and not Path(name).exists():
            hint = suggest_name(name, _WORDS)
            options.usage_error(f"expected a file or one of {', '.join(_WORDS)}; got {name}{hint}")
    return tuple(dict.fromkeys(words))


def _write_label_page(options: argparse.Namespace) -> int:
    if options.output is None or options.output.suffix.lower() != ".html":
        options.usage_error(f"-o must be an .html file with {LABEL}, got {options.output}")
    target: Path = options.output
    check_writable([target], force=options.force)
    library = load_library(options)
    items = label_items(library, options.count, seed=options.seed or 0)
    page = label_page(library, items)
    target.parent.mkdir(parents=True, exist_ok=True)
    path = page.save(target, force=True)
    print_remark(
        f"{len(items)} pieces: open the page, press F or J for each piece, save the labels, and "
        "pass them to mograft evaluate --labels labels.csv with the same files and options"
    )
    print_result(options, "label", {"file": str(path), "pieces": len(items)}, [path])
    return 0
