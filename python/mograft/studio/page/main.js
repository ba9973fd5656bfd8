// Start of the studio: listen to the server, draw, and connect buttons and keys.
import { ink, readTheme } from "/viewer/colours.js";
import { find, root } from "/viewer/scene.js";
import { startCards } from "./cards.js";
import { startConstraints } from "./constraints.js";
import { startCurves } from "./curves.js";
import { startExport } from "./exporting.js";
import { startGizmo } from "./gizmo.js";
import { startGroups } from "./groups.js";
import { startKeys } from "./keys.js";
import { listen, say } from "./net.js";
import { startScenario } from "./scenario.js";
import { startSegment } from "./segment.js";
import { startSources } from "./sources.js";
import { startStage } from "./stage.js";
import { emit, refresh, store } from "./store.js";
import { startTimeline } from "./timeline.js";
import { listenToTabs } from "./ui.js";
import { redrawAll, startView } from "./view.js";

const drawing = [startView, startGizmo, startStage, startTimeline, startCurves];
const panels = [startCards, startSegment, startConstraints, startScenario, startSources, startGroups, startExport];
for (const start of [...drawing, ...panels, startKeys]) start();
for (const list of root.querySelectorAll('[role="tablist"]')) listenToTabs(list);

function changeTheme() {
  readTheme();
  find("theme").textContent = ink.dark ? "Light page" : "Dark page";
  emit("theme");
  redrawAll();
}
find("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = ink.dark ? "light" : "dark";
  changeTheme();
});
changeTheme();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changeTheme);

listen(
  (event) => {
    if (event.kind === "note") say(event.text);
    if (event.kind === "progress") emit("progress", event);
    if (event.revision !== undefined && event.revision !== store.project?.revision) refresh();
  },
  () => refresh().then(() => (root.dataset.ready = "1")),
);
