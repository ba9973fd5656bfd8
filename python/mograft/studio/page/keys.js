// Buttons of the stage and the header, and the keyboard.
import { state } from "/viewer/scene.js";
import { openExport } from "./exporting.js";
import { setMode } from "./gizmo.js";
import { cancelGroups } from "./groups.js";
import { cut, nFrames, play, player, seek } from "./player.js";
import { setDrawing } from "./scenario.js";
import { change, toggleLock } from "./segment.js";
import { openFiles } from "./sources.js";
import { orbit, redrawStage, resetCamera, standStill, zoom } from "./stage.js";
import { act, emit, focusOn, on, store } from "./store.js";
import { setRange } from "./timeline.js";
import { parts, sentence } from "./ui.js";
import { redrawAll } from "./view.js";

// The switches: those of the page, and those that the drawing of figures reads.
const TOGGLES = { f: "follow", v: "onion", g: "floor", l: "loop", c: "colours", m: "mesh" };
const holder = (name) => (name in state && name !== "follow" && name !== "loop" ? state : store);

export function toggle(name) {
  const own = holder(name);
  own[name] = !own[name];
  parts[name].setAttribute("aria-pressed", own[name]);
  if (name === "follow") standStill();
  if (["colours", "mesh", "floor"].includes(name)) redrawAll();
  else redrawStage();
}

function setLayout(value) {
  store.layout = value;
  parts.layout.value = value;
  emit("layout");
}

function escape() {
  setDrawing(false);
  cancelGroups();
  store.constraint = null;
  emit("constraint");
  focusOn(null);
}

const undo = (action) => store.project?.[action] !== null && act({ action });

const KEYS = {
  ArrowRight: (event) => seek(player.frame + (event.shiftKey ? 10 : 1)),
  ArrowLeft: (event) => seek(player.frame - (event.shiftKey ? 10 : 1)),
  Home: () => seek(0),
  End: () => seek(nFrames() - 1),
  "[": () => cut(-1),
  "]": () => cut(1),
  i: () => setRange(0),
  u: () => setRange(1),
  k: toggleLock,
  n: () => change("change"),
  r: () => change("regenerate"),
  b: () => change("restore"),
  o: () => setLayout({ beside: "overlay", overlay: "graft", graft: "beside" }[store.layout]),
  1: () => setMode("translate"),
  2: () => setMode("rotate"),
  3: () => setMode("scale"),
  Escape: escape,
  a: () => orbit(-0.15, 0),
  d: () => orbit(0.15, 0),
  w: () => orbit(0, 0.1),
  s: () => orbit(0, -0.1),
  "+": () => zoom(1.2),
  "-": () => zoom(1 / 1.2),
  0: resetCamera,
  "?": () => parts.keys.showModal(),
};
const WITH_CONTROL = {
  z: (event) => undo(event.shiftKey ? "redo" : "undo"),
  y: () => undo("redo"),
  o: openFiles,
  e: () => !parts.export.disabled && openExport(),
};

const isText = (element) => element.closest("input:not([type=checkbox]):not([type=radio]):not([type=range]), textarea, select");
const isPressed = (element) => element.closest("button, summary, a, input, select");

export function startKeys() {
  parts.play.addEventListener("click", () => play());
  parts.back.addEventListener("click", () => cut(-1));
  parts.on.addEventListener("click", () => cut(1));
  parts.frame.addEventListener("change", (event) => seek(Number(event.target.value) || 0));
  parts.speed.addEventListener("input", (event) => {
    player.speed = Number(event.target.value);
    parts.speedText.textContent = `${player.speed}×`;
  });
  parts.layout.addEventListener("change", (event) => setLayout(event.target.value));
  for (const name of Object.values(TOGGLES)) parts[name].addEventListener("click", () => toggle(name));
  parts.hush.addEventListener("click", () => (parts.message.hidden = true));
  parts.reset.addEventListener("click", resetCamera);
  parts.help.addEventListener("click", () => parts.keys.showModal());
  parts.undo.addEventListener("click", () => undo("undo"));
  parts.redo.addEventListener("click", () => undo("redo"));
  on("project", writeUndo);
  on("character", () => {
    parts.mesh.hidden = false;
    if (state.colours) toggle("colours");
  });
  document.addEventListener("keydown", onKey);
}

function onKey(event) {
  if (document.querySelector("dialog[open]") || event.defaultPrevented || event.altKey) return;
  const { target, key } = event;
  if (event.ctrlKey || event.metaKey) {
    const act = WITH_CONTROL[key.toLowerCase()];
    if (!act || (isText(target) && "zy".includes(key.toLowerCase()))) return;
    event.preventDefault();
    return act(event);
  }
  if (isText(target)) return;
  if (key === " ") {
    if (isPressed(target)) return;
    event.preventDefault();
    return play();
  }
  if (target.type === "range" && (key.startsWith("Arrow") || key === "Home" || key === "End")) return;
  const act = KEYS[key] || (TOGGLES[key] && (() => toggle(TOGGLES[key])));
  if (!act) return;
  event.preventDefault();
  act(event);
}

function writeUndo() {
  for (const name of ["undo", "redo"]) {
    const text = store.project[name];
    const element = parts[name];
    element.disabled = text === null || text === undefined;
    element.title = text ? sentence(`${name}: ${text}`) : `Nothing to ${name}`;
  }
}
