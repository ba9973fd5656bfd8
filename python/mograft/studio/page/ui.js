// Small parts of the page: elements, tabs, dialogs and fields.
import { create } from "/viewer/scene.js";

export { create, createButton } from "/viewer/scene.js";

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
export function selectInput(options, value, given = {}) {
  const input = make("select", given);
  for (const own of options) {
    const [key, text] = Array.isArray(own) ? own : [own, own];
    input.append(make("option", { value: key, text }));
  }
  if (value !== undefined && value !== null) input.value = value;
  return input;
}

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

// A dialog with a heading; it is removed when it is closed, and the focus returns.
export function openDialog(title, ...children) {
  const before = document.activeElement;
  const dialog = make("dialog", { "aria-label": title, class: "dialog" }, make("h2", { text: title }), ...children);
  document.getElementById("mograft").append(dialog);
  dialog.addEventListener("close", () => {
    dialog.remove();
    before?.focus();
  });
  dialog.showModal();
  return dialog;
}

export const percent = (share) => `${Math.round(100 * share)} %`;
export const range = (first, last) => (first === last ? `${first}` : `${first}–${last}`);
