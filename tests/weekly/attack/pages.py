"""Pages with hostile names in a browser: no script of a name runs."""

from dataclasses import replace

import mograft as mg
from mograft import Library
from mograft.dancer import dance
from tests.browser import chromium, open_page
from tests.strategies import HOSTILE_NAMES
from tests.weekly.attack.outcome import Outcome


def hostile_pages(folder, count):
    """Open pages and reports of motions, joints and files with hostile names, with and without CSP.

    The names set the title of the page to "owned" if they run.
    """
    outcome = Outcome()
    motion = dance(seed=5, strides=1).motion[:120]
    names = [name for name in HOSTILE_NAMES if name]
    with chromium() as browser:
        for number in range(count):
            name = names[number // 4 % len(names)]
            joints = [
                name if joint == 7 else own for joint, own in enumerate(motion.skeleton.names)
            ]
            hostile = replace(
                motion, name=name, skeleton=replace(motion.skeleton, names=tuple(joints))
            )
            if number // 2 % 2:
                html = mg.report_page([mg.graft(Library.build(hostile))], title=name).html
            else:
                html = mg.view(hostile, title=name).html
            if number % 2:
                html = html.replace("Content-Security-Policy", "X-None")
            path = folder / f"{number}.html"
            path.write_text(html, encoding="utf-8", errors="replace")
            outcome.trials += 1
            try:
                with open_page(browser, path) as page:
                    page.wait_for_timeout(50)
                    if page.evaluate("document.title") == "owned":
                        outcome.failures.append(f"{name!r} ran")
            except Exception as error:  # console output, requests and errors
                outcome.failures.append(f"{name!r}: {error!r}"[:300])
    return outcome
