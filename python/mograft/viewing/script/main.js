// Start: read the data, draw, and listen to pointer and keyboard.
import { actorOf, hasMesh } from "./actors.js";
import { loadCharacters } from "./character.js";
import { commandOf } from "./choices.js";
import { groupColour, ink, readTheme } from "./colours.js";
import { describe, preview, writeDetail, writeTable } from "./details.js";
import { makeCaptions, makeFigureButtons, placeCaptions, showFigures, writeCaptions } from "./figures.js";
import { listenToKeys, listenToStage, listenToTimeline, resetCamera, toggle, TOGGLES } from "./input.js";
import { cut, draw, onDraw, play, redraw, seconds, seek, show, writeFrame, zoomTime } from "./player.js";
import { load, makePose, nodePlace, setPose } from "./poses.js";
import { clips, create, find, marks, nFrames, overview, root, rows, scene, shownClips, size, stage, state } from "./scene.js";
import { drawStage, startStage } from "./stage.js";
import { drawOverview, drawRows, layOutRows, timeline } from "./timeline.js";

const sliders = [rows, overview];

function writeSliders() {
  for (const slider of sliders) {
    const ariaValueText = `frame ${state.frame} of ${nFrames - 1}, ${seconds()} seconds`;
    Object.assign(slider, { ariaValueNow: state.frame, ariaValueText });
  }
}

function resize() {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  Object.assign(size, { width: stage.clientWidth, height: stage.clientHeight, ratio });
  timeline.gutter = overview.clientWidth < 600 ? 104 : 160;
  for (const canvas of [marks, rows, overview]) {
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
  }
  placeCaptions();
  draw();
}

function onFiguresChange() {
  layOutRows();
  describeStage();
  if (find("parts").open) writeTable();
  resize();
}

function describeStage() {
  const names = shownClips().map(({ name }) => name);
  stage.ariaLabel = `Moving figures: ${names.join(" and ")}. Space plays, arrow keys step.`;
  find("overlay").hidden = state.shown.length < 2;
  find("loop").hidden = find("parts").hidden = !timeline.lines.length;
}

function writeLegend() {
  const items = scene.groups.map((group) => {
    const item = create("li");
    const dot = create("i");
    dot.style.background = groupColour(group);
    item.append(dot, create("bdi", group));
    return item;
  });
  find("legend").replaceChildren(...items);
}

function changeTheme() {
  readTheme();
  find("theme").textContent = ink.dark ? "Light page" : "Dark page";
  writeLegend();
  redraw();
}

function listenToButtons() {
  find("play").addEventListener("click", () => play());
  find("back").addEventListener("click", () => cut(-1));
  find("on").addEventListener("click", () => cut(1));
  find("speed").addEventListener("change", (event) => (state.speed = Number(event.target.value)));
  find("frame").addEventListener("change", (event) => {
    seek(Number(event.target.value) || 0);
    event.target.blur(); // The keys control the player again.
  });
  for (const name of Object.values(TOGGLES)) {
    find(name).addEventListener("click", () => toggle(name));
  }
  find("wider").addEventListener("click", () => zoomTime(2, state.frame));
  find("nearer").addEventListener("click", () => zoomTime(0.5, state.frame));
  find("reset").addEventListener("click", resetCamera);
  find("theme").addEventListener("click", () => {
    document.documentElement.dataset.theme = ink.dark ? "light" : "dark";
    changeTheme();
  });
  find("help").addEventListener("click", () => find("keys").showModal());
  find("close").addEventListener("click", () => find("keys").close());
  find("parts").addEventListener("toggle", (event) => event.target.open && writeTable());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changeTheme);
}

function prepare() {
  changeTheme();
  makeCaptions();
  makeFigureButtons(onFiguresChange);
  for (const slider of sliders) Object.assign(slider, { ariaValueMin: 0, ariaValueMax: nFrames - 1 });
  find("frame").max = nFrames - 1;
  find("total").textContent = `of ${nFrames - 1}`;
  find("note").textContent = scene.note;
  const hasClusters = clips.some(({ rows: own }) => own.some(({ cluster }) => cluster.some((number) => number >= 0)));
  find("clusters").hidden = !hasClusters;
  find("mesh").hidden = !hasMesh();
  find("colours").ariaPressed = state.colours = !hasMesh();
  for (const drawer of [drawStage, writeCaptions, drawRows, drawOverview, writeDetail, writeFrame, writeSliders]) {
    onDraw(drawer);
  }
}

// If blocks are too narrow for their names, only a part of the timeline is visible at first.
function fitTimeline() {
  const most = Math.max(0, ...timeline.lines.map((line) => line.row.start.length));
  const room = Math.max(rows.clientWidth / 90, 6);
  if (most > 1.5 * room) show(0, ((nFrames - 1) * room) / most);
}

async function begin() {
  const characters = scene.objects.filter(({ kind }) => kind === "figure").map(({ clip }) => clip);
  await Promise.all([...[...shownClips(), ...characters].map(load), loadCharacters()]);
  startStage();
  prepare();
  onFiguresChange();
  fitTimeline();
  listenToStage();
  listenToTimeline(rows, true);
  listenToTimeline(overview, false);
  listenToKeys();
  listenToButtons();
  new ResizeObserver(resize).observe(root);
  draw();
  root.dataset.ready = "1";
  // Interface for scripts: tests, and other scripts in the page.
  const moveTo = (frame) => {
    seek(frame);
    draw();
  };
  const show = async (indices) => {
    await Promise.all(indices.map((i) => load(clips[i])));
    showFigures(indices, onFiguresChange);
  };
  const parts = { show, scene, state, timeline, actorOf, commandOf, describe, makePose, nodePlace, preview, setPose };
  window.mograft = { frames: nFrames, seek: moveTo, frame: () => state.frame, ...parts };
}

begin().catch((error) => {
  find("detail").textContent = `The motion cannot be shown: ${error.message}`;
  root.dataset.ready = "failed";
});
