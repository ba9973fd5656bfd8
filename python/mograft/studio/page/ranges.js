// The frames of constraints, as bars below the lanes; their ends can be moved.
import { frameAt, place } from "./timeline.js";
import { nFrames, seek } from "./player.js";
import { act, emit, store } from "./store.js";
import { button, icon, make, range } from "./ui.js";
import { titleOf, violationText, worstOf } from "./records.js";

export function laneOfConstraints(motion) {
  return motion.constraints
    .filter(({ number, record }) => isShown(record) || motion.violations.some((own) => own.number === number))
    .map((own) => {
      const { number, record } = own;
      const violated = motion.violations.filter((each) => each.number === number);
      const name = titleOf(motion, number);
      const [first, last] = record.frames || [0, nFrames() - 1];
      const text = record.frames ? range(first, last) : "all frames";
      const given = { class: "bar-range", "aria-label": `${name}, ${text}` };
      const bar = button("", `${name}: ${text}; drag an end to change it`, () => chooseConstraint(number), given);
      bar.append(make("span", { text: violated.length ? "" : text }));
      if (record.frames) for (const end of [0, 1]) bar.append(makeHandle(motion, own, bar, end));
      const element = make("div", { class: "lane thin" }, place(bar, first, Math.max(last, first + 1)));
      element.append(...violated.map((each) => makeMark(name, each)));
      return { name, element };
    });
}

// The frames in which a constraint is violated.
function makeMark(name, own) {
  const show = () => {
    seek(worstOf(own));
    chooseConstraint(own.number);
  };
  const text = `${name}: ${violationText(own)}`;
  const mark = button("", text, show, { class: "violated", "aria-label": text });
  mark.append(icon("warn"));
  return place(mark, own.first, Math.max(own.last, own.first + 1));
}

// Constraints on donors are choices of the timeline itself.
const isShown = ({ kind }) => ["Avoid", "AvoidSelf", "KeepOut", "Reach", "Face"].includes(kind);

export function chooseConstraint(number) {
  store.constraint = number;
  document.getElementById("tab-constraints").click();
  emit("constraint");
}

function makeHandle(motion, { number, record }, bar, end) {
  const handle = make("i", { class: end ? "handle end-handle" : "handle" });
  let frames = [...record.frames];
  handle.addEventListener("pointerdown", (event) => {
    event.stopPropagation();
    event.preventDefault();
    handle.setPointerCapture(event.pointerId);
  });
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    const at = frameAt(event);
    frames = end ? [frames[0], Math.max(at, frames[0])] : [Math.min(at, frames[1]), frames[1]];
    place(bar, frames[0], Math.max(frames[1], frames[0] + 1));
    bar.querySelector("span").textContent = range(...frames);
  });
  handle.addEventListener("pointerup", () => {
    if (String(frames) === String(record.frames)) return;
    const { frame, ...rest } = record;
    act({ action: "set_constraint", id: motion.id, number, constraint: { ...rest, frames } }, { isQuiet: true });
  });
  handle.addEventListener("click", (event) => event.stopPropagation());
  return handle;
}
