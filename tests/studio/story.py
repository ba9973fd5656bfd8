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

LISTED = "table.donors tbody:not([aria-busy])"  # the donors of the selection itself
AVOIDS = "motion.constraints.some(({ record }) => record.kind === 'Avoid')"
STATE = "(await (await fetch('/api/state')).json())"


@contextlib.contextmanager
def opened(browser, session, size=(1280, 800), theme="light", expected=()):
    """Open the page of a session.

    Fail on refused requests and on console output, except for `expected` words, and on requests to
    other servers.
    """
    reports = []
    with (
        StudioServer(session, session.folder, report=reports.append) as server,
        new_page(browser, *size, theme, expected, reduced_motion="reduce") as page,
    ):
        page.set_default_timeout(_TIMEOUT_MILLISECONDS)
        page.goto(server.url)
        page.wait_for_selector("#mograft[data-ready='1']")
        yield page
    known = (f"{server.url.partition('/?')[0]}/", "blob:", "data:")
    assert [own for own in page.requests if not own.startswith(known)] == []
    assert expected or reports == []


@contextlib.contextmanager
def studio(browser, folder, size=(1280, 800), theme="light"):
    """Open an empty studio."""
    folder.mkdir(exist_ok=True)
    with (
        contextlib.closing(Session(folder)) as session,
        opened(browser, session, size, theme) as page,
    ):
        yield Person(page, session)


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

    def check_played(self, lock):
        """Check that the frames played are those of a lock."""
        for _ in range(5):
            self.page.wait_for_timeout(150)
            frame = int(self.page.get_by_label("frame", exact=True).input_value())
            assert lock["first"] <= frame <= lock["last"]

    def play_story(self, path, base, look=lambda _: None):
        """Make, judge, exchange, lock, avoid, repeat and export by the pointer.

        `look` is called with the name of each state of docs/studio.md.
        """
        page = self.page
        self.drop(path)
        page.get_by_role("tab", name="New motions").click()
        page.get_by_role("combobox", name="base motion", exact=True).first.select_option(base)
        self.button("Make 12 motions").click()
        state = self.until("state.motions.length >= 12 && !state.jobs.length")
        assert len({own["hash"] for own in state["motions"]}) == 12
        page.locator(".card .preview").nth(1).click()
        page.get_by_role("button", name="Favourite").nth(1).click()
        page.get_by_role("button", name="Reject").nth(2).click()
        self.until_second("motion.mark === 'star'")
        look("motions")

        self.blocks("upper").nth(2).click()
        row = page.locator(f"{LISTED} tr", has=page.locator("button:enabled", has_text="Use"))
        old = self.state()["motions"][1]["hash"]
        row.first.hover()
        look("donors")
        row.first.get_by_role("button", name="Use").click()
        self.until_second(f"motion.hash !== '{old}'")
        self.button("Lock").click()
        (lock,) = self.until_second("motion.locks.length")["locks"]
        assert lock["group"] == "upper"

        page.get_by_role("tab", name="Obstacles, targets").click()
        page.get_by_role("combobox", name="new", exact=True).select_option("Sphere to avoid")
        self.button("Add").click()
        motion = self.until_second(AVOIDS)
        look("obstacle")
        radius = motion["constraints"][-1]["record"]["obstacle"]["radius"]
        page.get_by_role("spinbutton", name="radius").fill(str(radius / 2))
        page.keyboard.press("Tab")
        is_smaller = f"motion.constraints.at(-1).record.obstacle.radius < {radius * 0.6}"
        assert self.until_second(is_smaller)["locks"] == [lock]

        page.keyboard.press("Escape")
        self.blocks("upper").nth(2).click()
        self.button("Repeat selection").click()
        self.button("Play").click()
        self.check_played(lock)
        self.button("Pause").click()

        page.locator(".card").nth(1).get_by_label("Keep").check()
        self.until_second("motion.isKept")
        self.button("Export 1 motion…").click()
        self.button("Export").click()
        page.locator(".dialog .result bdi").wait_for()
        look("export")
