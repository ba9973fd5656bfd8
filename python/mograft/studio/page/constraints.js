// Constraints of the selected motion as a list of forms, and what they violate.
import { player, mainFigure, nFrames, seek } from "./player.js";
import { say } from "./net.js";
import { act, emit, on, selected, store } from "./store.js";
import { button, field, fill, icon, make, numberInput, parts, range, selectInput, sentence } from "./ui.js";
import { countViolated, DEFAULTS, FIELDS, framesText, NEW, newRecord, obstacleOf } from "./records.js";
import { titleOf, upOf, violationText, worstOf } from "./records.js";

const HINT = "Choose what the figure shall avoid or reach, and Add. Move it on the stage or by numbers: the motion is solved again.";
let written = "";

const clipNames = () => store.project.clips.map(({ name }) => name);
export const jointNames = () => (store.project?.skeleton?.joints || []).map(({ name }) => name);
export const setConstraint = (motion, number, constraint, isPreview = false) =>
  act({ action: "set_constraint", id: motion.id, number, constraint, ...(isPreview && { preview: true }) }, { isQuiet: true });

export function startConstraints() {
  fill(parts.newKind, Object.keys(NEW));
  parts.addConstraint.addEventListener("click", add);
  on("project selected figure", write);
  on("constraint", () => {
    markChosen();
    parts.constraints.querySelector(".selected")?.scrollIntoView({ block: "nearest" });
  });
}

async function add() {
  const [motion, clip] = [selected(), mainFigure()];
  const { addConstraint } = parts;
  if (!motion || !clip || addConstraint.ariaBusy === "true") return;
  const frames = store.focus ? [store.focus.first, store.focus.last] : null;
  const clips = clipNames();
  const clipName = clips.includes(motion.base) ? motion.base : clips[0];
  const given = { joints: jointNames(), frame: player.frame, frames, clipName };
  const constraint = newRecord(parts.newKind.value, clip, motion.constraints, given);
  Object.assign(addConstraint, { ariaBusy: "true", textContent: "Adding…" });
  const reply = await act({ action: "add_constraint", id: motion.id, constraint }, { isQuiet: true });
  Object.assign(addConstraint, { ariaBusy: "false", textContent: "Add" });
  if (!reply || selected()?.id !== motion.id) return;
  store.constraint = selected().constraints.at(-1)?.number ?? null;
  say(`${titleOf(selected(), store.constraint)} added.`);
  emit("constraint");
}

function write() {
  const motion = selected();
  parts.addConstraint.disabled = !motion;
  const isLoaded = mainFigure() !== null; // Its axes are needed.
  const key = JSON.stringify([motion?.id, motion?.constraints, motion?.violations, motion?.remarks, isLoaded]);
  if (key === written) return;
  written = key;
  const own = (isLoaded && motion?.constraints) || [];
  parts.noConstraint.hidden = own.length > 0;
  parts.noConstraint.textContent = motion ? HINT : "Make or select a motion first.";
  const count = motion ? countViolated(motion) : 0;
  parts.remedy.hidden = !count;
  parts.remedy.textContent = count && `${sentence(motion.remarks.at(-1) || "")}.`;
  const others = (motion?.violations || []).filter(({ number }) => !own.some((each) => each.number === number));
  parts.violations.replaceChildren(...others.map((each) => make("li", {}, violationLine([each]))));
  const focused = document.activeElement?.dataset?.field;
  parts.constraints.replaceChildren(...own.map((each) => makeForm(motion, each)));
  if (focused) parts.constraints.querySelector(`[data-field="${CSS.escape(focused)}"]`)?.focus();
  const tab = document.getElementById("tab-constraints");
  tab.replaceChildren("Obstacles, targets", ...(count ? [make("span", { class: "count-tag", text: `${count} violated` })] : []));
  markChosen();
}

// The violations of one constraint: the first in words, the frames of the others.
function violationLine(all) {
  const line = make("div", { class: "violations" });
  for (const [i, own] of all.entries()) {
    const item = button("", `Go to frame ${worstOf(own)}`, () => seek(worstOf(own)), { class: "plain" });
    item.append(...(i ? [range(own.first, own.last)] : [icon("warn"), violationText(own)]));
    line.append(i === 1 ? "also in frames " : "", item);
  }
  return line;
}

function markChosen() {
  for (const form of parts.constraints.children) {
    const isChosen = Number(form.dataset.number) === store.constraint;
    form.classList.toggle("selected", isChosen);
    form.querySelector(".choose").setAttribute("aria-pressed", isChosen);
  }
}

function makeForm(motion, { number, record }) {
  const name = titleOf(motion, number);
  const violations = motion.violations.filter((own) => own.number === number);
  const isShape = Boolean(FIELDS[record.kind]);
  const toggle = () => {
    store.constraint = store.constraint === number ? null : number;
    emit("constraint");
  };
  const choose = button("Move on the stage", "Show or hide the arrows that move it", toggle, { class: "choose", hidden: !isShape });
  const remove = () => act({ action: "drop_constraint", id: motion.id, number }, { said: `${name} removed.` });
  const drop = button("Remove", "Remove it; the parts of the motion stay", remove, { "aria-label": `Remove ${name}` });
  const isKept = isShape && !violations.length;
  const kept = isKept ? make("span", { class: "tag", text: "✓ satisfied", title: "In all its frames" }) : null;
  const head = make("div", { class: "head" }, make("h3", { text: name }), make("span", { class: "faint", text: framesText(record) }), kept);
  const buttons = make("div", { class: "row" }, choose, drop);
  const form = make("div", { class: "constraint", role: "group", "aria-label": name }, head, buttons);
  form.dataset.number = number;
  if (violations.length) form.append(violationLine(violations));
  const save = (next) => setConstraint(motion, number, next);
  const obstacle = obstacleOf(record);
  const key = record.obstacle ? "obstacle" : "region";
  if (obstacle)
    for (const own of FIELDS[obstacle.kind] || [])
      form.append(makeField(number, own, obstacle, (value) => save({ ...record, [key]: { ...obstacle, [own[0]]: value } })));
  for (const own of FIELDS[record.kind] || [])
    form.append(makeField(number, own, record, (value) => save({ ...record, [own[0]]: value })));
  if (FIELDS[record.kind]) form.append(framesField(number, record, save));
  return form;
}

const turnAbout = (up, angle) => new THREE.Quaternion().setFromAxisAngle(up, angle).toArray();
const angleAbout = (up, [x, y, z, w]) => 2 * Math.atan2(new THREE.Vector3(x, y, z).dot(up), w);

// Numbers as people see them: the unit, and the conversions from a value and to it.
const SCALES = {
  length: ["", (value) => value, (shown) => shown],
  seconds: ["seconds", (value) => value, (shown) => shown],
  heights: ["body heights", (value) => value, (shown) => shown],
  angle: ["degrees", THREE.MathUtils.radToDeg, THREE.MathUtils.degToRad],
  yaw: [
    "degrees",
    (value) => Math.round(THREE.MathUtils.radToDeg(angleAbout(upOf(mainFigure()), value))),
    (shown) => turnAbout(upOf(mainFigure()), THREE.MathUtils.degToRad(shown)),
  ],
};

// A number field that saves what is entered, unless it is no number.
function entry(value, save, given) {
  const onchange = ({ target }) =>
    target.value.trim() !== "" && Number.isFinite(Number(target.value)) && save(Number(target.value));
  return numberInput(Number(value.toPrecision(4)), { ...given, onchange });
}

export function entries(text, values, save, given) {
  const inputs = values.map((own, i) =>
    entry(own, (next) => save(values.map((old, k) => (k === i ? next : old))), {
      "aria-label": `${text} ${given.names[i]}`,
      "data-field": `${given.key}/${i}`,
      ...given.input,
    }),
  );
  const labelled = inputs.map((own, i) => make("span", { class: "axis" }, given.names[i], own));
  return make("div", { class: "field vector", role: "group", "aria-label": text }, make("span", { text }), ...labelled);
}

function makeField(id, [name, text, kind], record, save) {
  const value = record[name] ?? DEFAULTS[name];
  const key = `${id}/${name}`;
  const tag = { "data-field": key };
  if (kind === "vector" || kind === "sizes") {
    if (!Array.isArray(value)) return make("p", { class: "faint", text: `${text}: relative to the figure` });
    return entries(text, value, save, { key, names: "xyz", input: kind === "sizes" ? { min: 0 } : {} });
  }
  if (kind === "clip") {
    return field(text, selectInput(clipNames(), value.name, { ...tag, onchange: ({ target }) => save({ name: target.value }) }));
  }
  if (kind.startsWith("joint")) {
    const options = [...(kind === "joint?" ? [["", "head"]] : []), ...jointNames()];
    return field(text, selectInput(options, value ?? "", { ...tag, onchange: ({ target }) => save(target.value || null) }));
  }
  if (kind === "flag") {
    const onchange = ({ target }) => save(target.checked);
    return field(text, make("input", { type: "checkbox", checked: Boolean(value), ...tag, onchange }));
  }
  const [unit, show, read] = SCALES[kind];
  const input = entry(show(value), (next) => save(read(next)), tag);
  return field(text, input, unit);
}

function framesField(id, record, save) {
  const { frame, ...rest } = record;
  const frames = record.frames || [0, nFrames() - 1];
  const isAll = !record.frames;
  const chosen = store.focus ? [store.focus.first, store.focus.last] : frames;
  const onchange = ({ target }) => save({ ...rest, frames: target.checked ? null : chosen });
  const isFixed = record.kind === "Reach";
  const all = make("input", { type: "checkbox", checked: isAll, disabled: isFixed, "data-field": `${id}/all`, onchange });
  const input = { step: 1, min: 0, max: nFrames() - 1, disabled: isAll };
  const given = { key: `${id}/frames`, names: ["first", "last"], input };
  const own = entries("frames", frames, (next) => save({ ...rest, frames: next.map(Math.round).sort((a, b) => a - b) }), given);
  own.append(make("label", { class: "set axis" }, all, "all frames"));
  return own;
}
