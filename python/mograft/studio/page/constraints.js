// Constraints of the selected motion as a list of forms, and what they violate.
import { player, mainFigure, nFrames, seek } from "./player.js";
import { act, emit, on, selected, store } from "./store.js";
import { button, field, icon, make, numberInput, selectInput } from "./ui.js";
import { DEFAULTS, FIELDS, framesText, nameOf, NEW, obstacleOf, upOf } from "./records.js";

const parts = {};
let written = "";

export const jointNames = () => (store.project?.skeleton?.joints || []).map(({ name }) => name);
export const setConstraint = (motion, number, constraint, isPreview = false) =>
  act({ action: "set_constraint", id: motion.id, number, constraint, ...(isPreview && { preview: true }) }, { isQuiet: true });

export function startConstraints() {
  const pane = document.getElementById("pane-constraints");
  parts.kind = selectInput(Object.keys(NEW), "Sphere", { "aria-label": "Kind of constraint" });
  parts.add = button("Add", "Add at the figure, for the selected frames or all", add);
  parts.list = make("div", { class: "constraints" });
  parts.none = make("p", { class: "faint", text: "Obstacles, targets of hands, feet and gaze: added at the figure, moved on the stage or by numbers." });
  parts.violations = make("ul", { class: "violations", "aria-label": "Violations" });
  pane.append(make("div", { class: "row" }, field("add", parts.kind), parts.add), parts.none, parts.violations, parts.list);
  on("project selected", write);
  on("constraint", markChosen);
}

async function add() {
  const [motion, clip] = [selected(), mainFigure()];
  if (!motion || !clip) return;
  const frames = store.focus ? [store.focus.first, store.focus.last] : null;
  const given = { joints: jointNames(), frame: player.frame, frames, clipName: motion.base };
  const made = NEW[parts.kind.value](clip, given);
  const constraint = frames && !made.frames ? { ...made, frames } : made;
  const reply = await act({ action: "add_constraint", id: motion.id, constraint });
  if (!reply) return;
  store.constraint = selected()?.constraints.at(-1)?.number ?? null;
  emit("constraint");
}

function write() {
  const motion = selected();
  parts.add.disabled = !motion;
  const key = JSON.stringify([motion?.id, motion?.constraints, motion?.violations, motion?.remarks, jointNames().length]);
  if (key === written) return;
  written = key;
  const own = motion?.constraints || [];
  parts.none.hidden = own.length > 0;
  const remarks = motion?.violations.length ? motion.remarks.slice(-1).map((text) => make("li", { text })) : []; // The remedy.
  parts.violations.replaceChildren(...(motion?.violations || []).map(violationItem), ...remarks);
  const focused = document.activeElement?.dataset?.field;
  parts.list.replaceChildren(...own.map((each) => makeForm(motion, each)));
  if (focused) parts.list.querySelector(`[data-field="${CSS.escape(focused)}"]`)?.focus();
  const tab = document.getElementById("tab-constraints");
  const count = motion?.violations.length || 0;
  tab.replaceChildren("Constraints", ...(count ? [make("span", { class: "count-tag", text: `${count} violated` })] : []));
  markChosen();
}

function violationItem({ first, text }) {
  const go = () => seek(first);
  const item = button("", "Go to these frames", go, { class: "plain" });
  item.append(icon("warn"), text);
  return make("li", {}, item);
}

function markChosen() {
  for (const form of parts.list.children) {
    const isChosen = Number(form.dataset.number) === store.constraint;
    form.classList.toggle("selected", isChosen);
    form.querySelector(".choose").setAttribute("aria-pressed", isChosen);
  }
}

function makeForm(motion, { number, record }) {
  const name = nameOf(record);
  const isShape = Boolean(FIELDS[record.kind]);
  const choose = button(name, "Select, to move it on the stage", () => {
    store.constraint = store.constraint === number ? null : number;
    emit("constraint");
  }, { class: isShape ? "choose" : "choose plain" });
  choose.disabled = !isShape;
  const drop = button("✕", "Remove", () => act({ action: "drop_constraint", id: motion.id, number }), { "aria-label": `Remove ${name}` });
  const head = make("div", { class: "head" }, choose, make("span", { class: "faint", text: framesText(record) }), drop);
  const form = make("div", { class: "constraint", role: "group", "aria-label": name }, head);
  form.dataset.number = number;
  const save = (next) => setConstraint(motion, number, next);
  const obstacle = obstacleOf(record);
  const key = record.obstacle ? "obstacle" : "region";
  if (obstacle) for (const own of FIELDS[obstacle.kind] || []) form.append(makeField(number, own, obstacle, (value) => save({ ...record, [key]: { ...obstacle, [own[0]]: value } })));
  for (const own of FIELDS[record.kind] || []) form.append(makeField(number, own, record, (value) => save({ ...record, [own[0]]: value })));
  if (FIELDS[record.kind]) form.append(framesField(number, record, save));
  return form;
}

const number = (text) => (text.trim() === "" || !Number.isFinite(Number(text)) ? null : Number(text));

function makeField(id, [name, text, kind], record, save) {
  const value = record[name] ?? DEFAULTS[name];
  const tag = { "data-field": `${id}/${name}` };
  const enter = (convert) => (event) => {
    const found = convert(event.target);
    if (found !== null) save(found);
  };
  if (kind === "vector" || kind === "sizes") {
    const values = Array.isArray(value) ? value : [0, 0, 0];
    const inputs = values.map((own, i) =>
      numberInput(Number(own.toPrecision(6)), { "aria-label": `${text} ${"xyz"[i]}`, "data-field": `${id}/${name}/${i}`, ...(kind === "sizes" && { min: 0 }), onchange: enter((input) => {
        const next = number(input.value);
        return next === null ? null : values.map((old, k) => (k === i ? next : old));
      }) }),
    );
    return make("div", { class: "field vector", role: "group", "aria-label": text }, make("span", { text }), ...inputs);
  }
  if (kind.startsWith("joint")) {
    const options = [...(kind === "joint?" ? [["", "head"]] : []), ...jointNames()];
    return field(text, selectInput(options, value ?? "", { ...tag, onchange: (event) => save(event.target.value || null) }));
  }
  if (kind === "flag") return field(text, make("input", { type: "checkbox", checked: Boolean(value), ...tag, onchange: (event) => save(event.target.checked) }));
  if (kind === "yaw") {
    const up = upOf(mainFigure());
    const turn = new THREE.Quaternion(...value);
    const axis = new THREE.Vector3(turn.x, turn.y, turn.z);
    const angle = 2 * Math.atan2(axis.dot(up), turn.w);
    const convert = (input) => new THREE.Quaternion().setFromAxisAngle(up, THREE.MathUtils.degToRad(Number(input.value))).toArray();
    return field(text, numberInput(Math.round(THREE.MathUtils.radToDeg(angle)), { ...tag, onchange: enter(convert) }), "°");
  }
  const isAngle = kind === "angle";
  const shown = isAngle ? (value * 180) / Math.PI : value;
  const convert = (input) => {
    const next = number(input.value);
    return next === null ? null : isAngle ? (next * Math.PI) / 180 : next;
  };
  const unit = { angle: "°", seconds: "s", heights: "heights" }[kind] || "";
  return field(text, numberInput(Number(shown.toPrecision(4)), { ...tag, onchange: enter(convert) }), unit);
}

function framesField(id, record, save) {
  const { frame, ...rest } = record;
  const frames = record.frames || [0, nFrames() - 1];
  const isAll = !record.frames;
  const all = make("input", { type: "checkbox", checked: isAll, disabled: record.kind === "Reach", "data-field": `${id}/all`, onchange: () => save({ ...rest, frames: all.checked ? null : (store.focus ? [store.focus.first, store.focus.last] : frames) }) });
  const inputs = frames.map((own, i) =>
    numberInput(own, { step: 1, min: 0, max: nFrames() - 1, disabled: isAll, "aria-label": i ? "last frame" : "first frame", "data-field": `${id}/frames/${i}`, onchange: (event) => {
      const next = frames.map((old, k) => (k === i ? Math.round(Number(event.target.value)) : old));
      save({ ...rest, frames: next.sort((a, b) => a - b) });
    } }),
  );
  return make("div", { class: "field vector", role: "group", "aria-label": "frames" }, make("span", { text: "frames" }), ...inputs, make("label", { class: "set" }, all, "all"));
}
