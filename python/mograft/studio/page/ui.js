// Small parts of the page: elements, tabs, dialogs and fields.
import { create, find } from "/viewer/scene.js";

export { create } from "/viewer/scene.js";

// The elements of the page by the names that they have in it.
const found = {};
export const parts = new Proxy(found, { get: (_, name) => (found[name] ||= find(name)) });

export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  use.setAttribute("href", `#i-${name}`);
  svg.append(use);
  return svg;
}

// An element with attributes and children; `on...` are listeners, other keys attributes or "text".
export function make(tag, given = {}, ...children) {
  const element = create(tag);
  for (const [name, value] of Object.entries(given)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "text") element.textContent = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else if (name === "value") element.value = value;
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export const button = (text, title, onclick, given = {}) => make("button", { type: "button", text, title, onclick, ...given });

// A field with its name before it.
export function field(name, input, unit = "") {
  const label = make("label", { class: "field" }, make("span", { text: name }), input);
  if (unit) label.append(make("span", { class: "unit", text: unit }));
  return label;
}
export const numberInput = (value, given = {}) => make("input", { type: "number", step: "any", value: String(value), ...given });
// Give a list its options, texts or pairs of value and text, and choose one.
export function fill(select, options, value) {
  const pairs = options.map((own) => (Array.isArray(own) ? own : [own, own]));
  const key = JSON.stringify(pairs);
  if (select.dataset.key !== key) select.replaceChildren(...pairs.map(([own, text]) => make("option", { value: own, text })));
  select.dataset.key = key;
  if (value !== undefined && value !== null) select.value = value;
  return select;
}
export const selectInput = (options, value, given = {}) => fill(make("select", given), options, value);

// A text that lines can break after each underscore.
export const breakable = (text) => text.split(/(?<=_)/).flatMap((part) => [part, make("wbr")]);

// A step of the server as people read it.
const KINDS = { Avoid: "obstacle", Reach: "target", Face: "target of the head", KeepOut: "region", AvoidSelf: "rule for limbs" };
const STEPS = { Use: "chosen part", Ban: "banned part", KeepOriginal: "captured part", ...KINDS };
export const sentence = (text) =>
  text && `${text[0].toUpperCase()}${text.slice(1)}`.replace(/(?<=(add|move|remove) )\w+$/i, (kind) => STEPS[kind] ?? kind);

// An element with a name from a file and a note.
export const named = (tag, given, name, note, kind = "faint") =>
  make(tag, given, make("bdi", {}, ...breakable(name)), note ? make("span", { class: kind, text: note }) : null);
export const details = (text, ...children) => make("details", {}, make("summary", { text }), ...children);
export const counted = (count, text) => `${count} ${text}${count === 1 ? "" : "s"}`;

// Tabs as the ARIA practices describe them: arrow keys move between them.
export function listenToTabs(list) {
  const tabs = [...list.querySelectorAll('[role="tab"]')];
  for (const tab of tabs) tab.addEventListener("click", () => showTab(tab));
  list.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const index = tabs.indexOf(event.target);
    if (index < 0 || (!step && event.key !== "Home" && event.key !== "End")) return;
    event.preventDefault();
    event.stopPropagation();
    const next = step ? (index + step + tabs.length) % tabs.length : event.key === "Home" ? 0 : tabs.length - 1;
    tabs[next].focus();
    showTab(tabs[next]);
  });
}
export function showTab(tab) {
  for (const own of tab.parentElement.querySelectorAll('[role="tab"]')) {
    own.setAttribute("aria-selected", own === tab);
    own.tabIndex = own === tab ? 0 : -1;
    document.getElementById(own.getAttribute("aria-controls")).hidden = own !== tab;
  }
  window.dispatchEvent(new Event("resize"));
}

export const percent = (share) => `${Math.round(100 * share)}\u00a0%`;
export const range = (first, last) => (first === last ? `${first}` : `${first}–${last}`);
