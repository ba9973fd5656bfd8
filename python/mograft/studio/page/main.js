// Start of the studio: listen to the server, draw, and connect buttons and keys.
import { readTheme } from "/viewer/colours.js";
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

readTheme();
startView();
startGizmo();
startStage();
startTimeline();
startCurves();
startCards();
startSegment();
startConstraints();
startScenario();
startSources();
startGroups();
startExport();
startKeys();
for (const list of root.querySelectorAll('[role="tablist"]')) listenToTabs(list);

export function changeTheme() {
  readTheme();
  emit("theme");
  redrawAll();
}
find("theme").addEventListener("click", () => {
  const isDark = getComputedStyle(root).getPropertyValue("--dark").trim() === "1";
  document.documentElement.dataset.theme = isDark ? "light" : "dark";
  changeTheme();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changeTheme);

listen(
  (event) => {
    if (event.kind === "note") say(event.text);
    if (event.kind === "progress") emit("progress", event);
    if (event.revision !== undefined && event.revision !== store.project?.revision) refresh();
  },
  () => refresh().then(() => (root.dataset.ready = "1")),
);
