// Joint groups: joints are clicked on the figure, or chosen in a list, and move to another group.
import { groupColour, ink } from "/viewer/colours.js";
import { nodePlace } from "/viewer/poses.js";
import { find, scene } from "/viewer/scene.js";
import { jointNames } from "./constraints.js";
import { mainFigure, poseNow } from "./player.js";
import { label, onMarks, onPointer, redrawStage } from "./stage.js";
import { act, emit, on, store } from "./store.js";
import { button, field, make, selectInput } from "./ui.js";

const REACH = 22; // Pixels around a joint in which a click chooses it.

let edited = null; // {base, names, of: group of each joint, chosen, hovered} while groups are edited.
const parts = {};

export function startGroups() {
  const pane = document.getElementById("pane-clips");
  parts.box = make("div", { class: "groups form", hidden: true, role: "group", "aria-label": "Groups of joints" });
  pane.prepend(parts.box);
  find("leftTabs").addEventListener("edit-groups", begin);
  onPointer("groups", { hover: (at, view) => hover(at, view), click: (at, view, event) => assign(nearest(at, view), !event.altKey) });
  onMarks(drawJoints);
  on("project", () => edited && jointNames().length !== edited.of.length && end());
}

function begin() {
  const { groups } = store.project;
  const of = jointNames().map((name) => Math.max(0, groups.names.findIndex((group) => groups.joints[group]?.includes(name))));
  edited = { base: groups.base, names: [...groups.names], of, chosen: Math.min(1, groups.names.length - 1), hovered: -1 };
  store.mode = "groups";
  emit("mode");
  emit("layout");
  find("hint").hidden = false;
  find("hint").textContent = "Click a joint to move it and those below it to the chosen group; with Alt only the joint.";
  write();
  parts.box.querySelector("input")?.focus();
}

function end() {
  edited = null;
  store.mode = "view";
  find("hint").hidden = true;
  parts.box.hidden = true;
  scene.groups = store.project.groups.names;
  repaint();
  emit("mode");
  emit("layout");
}

// Show the edited groups on the figure.
function repaint() {
  const clip = mainFigure();
  if (clip) {
    clip.captured ||= { group: clip.group, groups: clip.groups };
    const joints = edited ? edited.of : clip.captured.group;
    clip.groups = edited ? edited.names : clip.captured.groups;
    clip.group = clip.captured.group.map((own, joint) => (edited && joint < edited.of.length ? joints[joint] : own));
    if (edited) scene.groups = edited.names;
    else delete clip.captured;
  }
  ink.version++;
  redrawStage();
}

function write() {
  parts.box.hidden = false;
  const choices = edited.names.map((name, index) => {
    const dot = make("i", { class: "dot" });
    dot.style.background = groupColour(name);
    const radio = make("input", { type: "radio", name: "group", checked: index === edited.chosen, onchange: () => (edited.chosen = index) });
    const count = edited.of.filter((own) => own === index).length;
    return make("label", { class: "set group" }, radio, dot, make("bdi", { text: name }), make("span", { class: "faint", text: `${count} joints${name === edited.base ? ", kept from the base" : ""}` }));
  });
  const name = make("input", { type: "text", "aria-label": "Name of a new group", placeholder: "new group", maxlength: "40" });
  const addGroup = () => {
    const text = name.value.trim();
    if (!text || edited.names.includes(text)) return;
    edited.names.push(text);
    edited.chosen = edited.names.length - 1;
    update();
  };
  const lists = jointNames().map((joint, index) => field(joint, selectInput(edited.names.map((own, k) => [k, own]), edited.of[index], { onchange: (event) => setGroup(index, Number(event.target.value), false) })));
  const isOpen = parts.box.querySelector("details")?.open;
  parts.box.replaceChildren(
    make("h3", { text: "Groups of joints" }),
    ...choices,
    make("div", { class: "set" }, name, button("Add group", "A further group", addGroup)),
    make("details", { open: Boolean(isOpen) }, make("summary", { text: "all joints" }), ...lists),
    make("div", { class: "row" }, button("Use these groups", "Build the library with them", apply, { class: "main" }), button("Cancel", "Escape", end)),
  );
}

function update() {
  const { activeElement } = document;
  const index = [...parts.box.querySelectorAll("input, select, button, summary")].indexOf(activeElement);
  write();
  repaint();
  if (index >= 0) parts.box.querySelectorAll("input, select, button, summary")[index]?.focus();
}

function setGroup(joint, group, isWithChildren) {
  const { joints } = store.project.skeleton;
  const isBelow = (index) => index === joint || (isWithChildren && joints[index].parent >= 0 && isBelow(joints[index].parent));
  edited.of = edited.of.map((own, index) => (isBelow(index) ? group : own));
  update();
}

function assign(joint, isWithChildren) {
  if (joint >= 0) setGroup(joint, edited.chosen, isWithChildren);
}

function nearest([x, y], view) {
  if (!view) return -1;
  const pose = poseNow(view.clip);
  const far = jointNames().map((_, joint) => {
    const [px, py, depth] = view.point(nodePlace(view.clip, pose, joint));
    return depth > 1 ? Infinity : Math.hypot(px - x, py - y);
  });
  const least = Math.min(...far);
  return least < REACH ? far.indexOf(least) : -1;
}

function hover(at, view) {
  const found = nearest(at, view);
  if (found === edited.hovered) return;
  edited.hovered = found;
  redrawStage();
}

function drawJoints(pen, view) {
  if (!edited || store.mode !== "groups") return;
  jointNames().forEach((name, joint) => {
    const [x, y, depth] = view.point(nodePlace(view.clip, view.clip.now, joint));
    if (depth > 1) return;
    const isHovered = joint === edited.hovered;
    pen.beginPath();
    pen.arc(x, y, isHovered ? 6 : 3.5, 0, 2 * Math.PI);
    pen.fillStyle = groupColour(edited.names[edited.of[joint]]);
    pen.strokeStyle = ink.paper;
    pen.lineWidth = 1.5;
    pen.fill();
    pen.stroke();
    pen.fillStyle = ink.text;
    if (isHovered) label(`${name} · ${edited.names[edited.of[joint]]}`, x, y - 12, view);
  });
}

async function apply() {
  const joints = jointNames();
  const text = (value) => JSON.stringify(value);
  const entries = edited.names.map((group, index) => [group, joints.filter((_, joint) => edited.of[joint] === index)]).filter(([, own]) => own.length);
  const lines = [`base = ${text(edited.base)}`, "", "[groups]", ...entries.map(([group, own]) => `${text(group)} = [${own.map(text).join(", ")}]`)];
  const reply = await act({ action: "set_groups", toml: `${lines.join("\n")}\n` });
  if (reply) end();
}

export const cancelGroups = () => edited && end();
