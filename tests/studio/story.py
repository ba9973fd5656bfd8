"""What a person does on the page of the studio, by the names of its controls."""

import base64
import contextlib

from mograft.studio.server import StudioServer
from mograft.studio.session import Session
from tests.browser import new_page, wait_until

_DROP = """([name, data]) => {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const transfer = new DataTransfer();
  transfer.items.add(new File([bytes], name));
  const given = { dataTransfer: transfer, bubbles: true, cancelable: true };
  for (const kind of ["dragenter", "dragover", "drop"])
    window.dispatchEvent(new DragEvent(kind, given));
}"""

_TIMEOUT_MILLISECONDS = 30_000  # of one step

STATE = "(await (await fetch('/api/state')).json())"


@contextlib.contextmanager
def studio(browser, folder, size=(1280, 800), theme="light"):
    """Open an empty studio; fail on errors of the page and on requests to other servers."""
    folder.mkdir(exist_ok=True)
    reports = []
    with (
        contextlib.closing(Session(folder)) as session,
        StudioServer(session, folder, report=reports.append) as server,
        new_page(browser, *size, theme, reduced_motion="reduce") as page,
    ):
        page.set_default_timeout(_TIMEOUT_MILLISECONDS)
        page.goto(server.url)
        page.wait_for_selector("#mograft[data-ready='1']")
        yield Person(page, session)
    known = (f"{server.url.partition('/?')[0]}/", "blob:", "data:")
    assert [own for own in page.requests if not own.startswith(known)] == []
    assert reports == []


class Person:
    """A person at the page, who reads names and uses the pointer or only the keyboard."""

    def __init__(self, page, session):
        self.page, self.session = page, session

    def state(self):
        """Return the state as the page reads it."""
        return self.page.evaluate(f"async () => {STATE}")

    def until(self, condition):
        """Wait until a JavaScript condition on ``state`` holds; return the state."""
        wait_until(self.page, f"(async () => {{ const state = {STATE}; return {condition}; }})()")
        return self.state()

    def until_second(self, condition):
        """Wait until a JavaScript condition on the second ``motion`` holds; return the motion."""
        wait_until(
            self.page,
            f"(async () => {{ const motion = {STATE}.motions[1]; return {condition}; }})()",
        )
        return self.state()["motions"][1]

    def drop(self, path):
        """Drop a file on the page, and wait for the library."""
        self.page.evaluate(_DROP, [path.name, base64.b64encode(path.read_bytes()).decode()])
        self.until("state.library.status === 'ready' || state.library.status === 'failed'")

    def button(self, name, within=None, *, is_exact=True):
        """Return a button by its name."""
        place = self.page if within is None else within
        return place.get_by_role("button", name=name, exact=is_exact)

    def blocks(self, group):
        """Return the blocks of a group's lane."""
        return self.page.locator(f'.lane[data-group="{group}"] .block')

    def press(self, control, key="Enter"):
        """Reach a control by the tab key alone, and press a key on it."""
        self.tab_to(control)
        self.page.keyboard.press(key)

    def tab_to(self, control):
        """Press tab until a control has the focus; each stop must be visible."""
        control.wait_for(state="attached")
        for _ in range(400):
            if control.evaluate("(own) => own === document.activeElement"):
                outline = "(own) => getComputedStyle(own).outlineStyle !== 'none'"
                assert control.evaluate(outline) or control.evaluate(
                    "(own) => own.type === 'range'"
                )
                return
            self.page.keyboard.press("Tab")
        raise AssertionError(f"the tab key does not reach {control}")
