"""``mograft evaluate``: measures of the grafts of a library."""

import json
from dataclasses import replace
from pathlib import Path

from mograft._util.atomic import write_text
from mograft.cli.configuration import load_library
from mograft.cli.files import check_suffix, check_writable
from mograft.cli.output import print_remark, print_result, show_progress
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import EVALUATION_TOPICS, EvaluateOptions
from mograft.errors import suggest_name
from mograft.evaluation import evaluate
from mograft.viewing.evaluation_report import evaluation_page, summarize

_WORDS = (*EVALUATION_TOPICS, "all")


def run(options: EvaluateOptions) -> int:
    """Run the command."""
    words = [name for name in options.files if name in _WORDS and not Path(name).exists()]
    files = tuple(name for name in options.files if name not in words)
    for name in files:
        if not Path(name).exists() and ((hint := suggest_name(name, _WORDS)) or "." not in name):
            raise UsageError(f"expected a file or one of {', '.join(_WORDS)}; got {name}{hint}")
    if not files:
        raise UsageError("expected one library or at least one motion file, got none")
    folder = options.output
    if folder is not None:
        check_suffix(folder, is_folder=True)
    paths = [] if folder is None else [folder / "evaluation.json", folder / "index.html"]
    check_writable(paths, force=options.force)
    library = load_library(replace(options, files=files), rate=options.rate)
    with show_progress() as progress:
        topics = EVALUATION_TOPICS if not words or "all" in words else tuple(dict.fromkeys(words))
        runs, bases, seed = options.runs, options.bases, options.seed or 0
        found = evaluate(library, topics, runs=runs, bases=bases, seed=seed, progress=progress)
    document = found.as_dict()
    if folder is not None:
        page = evaluation_page(found)
        folder.mkdir(parents=True, exist_ok=True)
        write_text(paths[0], json.dumps(document, indent=1, allow_nan=False) + "\n")
        page.save(paths[1], force=True)
    if not options.json:
        for sentence in summarize(found):
            print_remark(sentence, is_result=True)
        if folder is None:
            print_remark("use -o DIR to write all numbers and a page to a folder")
    print_result(options, "evaluation/1", document, paths)
    return 0
