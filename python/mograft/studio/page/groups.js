// Joint groups: joints are clicked on the figure, or chosen in a list, and move to another group.
import { groupColour, ink } from "/viewer/colours.js";
import { nodePlace } from "/viewer/poses.js";
import { scene } from "/viewer/scene.js";
import { jointNames } from "./constraints.js";
import { mainFigure, poseNow } from "./player.js";
import { label, onMarks, onPointer, redrawStage, setStageMode } from "./stage.js";
import { act, on, store } from "./store.js";
import { button, field, make, parts, selectInput } from "./ui.js";

const HINT = "Click a joint to put it, and those below it in the skeleton, into the chosen group; with Alt only the joint.";
const REACH = 22; // Pixels around a joint in which a click chooses it.

let edited = null; // {base, names, of: group of each joint, chosen, hovered} while groups are edited.

export function startGroups() {
  parts.editGroups.addEventListener("click", begin);
  onPointer("groups", { hover, click: (at, view, event) => assign(nearest(at, view), !event.altKey) });
  onMarks(drawJoints);
  on("project", () => edited && jointNames().length !== edited.of.length && end());
}

function begin() {
  const { groups } = store.project;
  const indexOf = (joint) => groups.names.findIndex((group) => groups.joints[group]?.includes(joint));
  const of = jointNames().map((joint) => Math.max(0, indexOf(joint)));
  edited = { base: groups.base, names: [...groups.names], of, chosen: Math.min(1, groups.names.length - 1), hovered: -1 };
  setStageMode("groups", HINT);
  write();
  parts.groupsEditor.querySelector("input")?.focus();
}

function end() {
  edited = null;
  parts.groupsEditor.hidden = true;
  scene.groups = store.project.groups.names;
  repaint();
  setStageMode("view");
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
  parts.groupsEditor.hidden = false;
  const choices = edited.names.map((name, index) => {
    const dot = make("i", { class: "dot" });
    dot.style.background = groupColour(name);
    const onchange = () => (edited.chosen = index);
    const radio = make("input", { type: "radio", name: "group", checked: index === edited.chosen, onchange });
    const count = `${edited.of.filter((own) => own === index).length} joints`;
    const note = make("span", { class: "faint", text: name === edited.base ? `${count}, stay as in the base motion` : count });
    return make("label", { class: "set group" }, radio, dot, make("bdi", { text: name }), note);
  });
  const name = make("input", { type: "text", "aria-label": "Name of a new group", placeholder: "name of a new group", maxlength: "40" });
  const addGroup = () => {
    const text = name.value.trim();
    if (!text || edited.names.includes(text)) return;
    edited.names.push(text);
    edited.chosen = edited.names.length - 1;
    update();
  };
  const options = edited.names.map((own, k) => [k, own]);
  const lists = jointNames().map((joint, index) => {
    const onchange = ({ target }) => setGroup(index, Number(target.value), false);
    return field(joint, selectInput(options, edited.of[index], { onchange }));
  });
  const isOpen = parts.groupsEditor.querySelector("details")?.open;
  const use = button("Use these groups", "Build the library with them", apply, { class: "main" });
  parts.groupsEditor.replaceChildren(
    make("h2", { text: "Joint groups" }),
    ...choices,
    make("div", { class: "set" }, name, button("Add group", "A further group", addGroup)),
    make("details", { open: Boolean(isOpen) }, make("summary", { text: "group of each joint" }), ...lists),
    make("div", { class: "row" }, use, button("Cancel", "Escape", end)),
  );
}

function update() {
  const { activeElement } = document;
  const index = [...parts.groupsEditor.querySelectorAll("input, select, button, summary")].indexOf(activeElement);
  write();
  repaint();
  if (index >= 0) parts.groupsEditor.querySelectorAll("input, select, button, summary")[index]?.focus();
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
  const entries = edited.names
    .map((group, index) => [group, joints.filter((_, joint) => edited.of[joint] === index)])
    .filter(([, own]) => own.length);
  const lines = entries.map(([group, own]) => `${text(group)} = [${own.map(text).join(", ")}]\n`);
  const reply = await act({ action: "set_groups", toml: `base = ${text(edited.base)}\n\n[groups]\n${lines.join("")}` });
  if (reply) end();
}

export const cancelGroups = () => edited && end();
