// Colours of the theme, of joint groups, of clips and of clusters.
import { root, scene } from "./scene.js";

export const ink = { version: 0 };

export function readTheme() {
  const style = getComputedStyle(root);
  for (const name of ["paper", "text", "faint", "line", "accent", "panel", "obstacle", "character", "body"]) {
    ink[name] = style.getPropertyValue(`--${name}`).trim();
  }
  ink.dark = style.getPropertyValue("--dark").trim() === "1";
  ink.group = Array.from({ length: 8 }, (_, i) => style.getPropertyValue(`--group${i}`).trim());
  ink.version++;
}

export function groupColour(name) {
  const index = scene.groups.indexOf(name);
  return index < 0 ? ink.faint : ink.group[index % ink.group.length];
}

// A colour for each number, far from those of the numbers before.
export function numberColour(number) {
  const hue = (number * 137.508 + 200) % 360;
  return ink.dark ? `hsl(${hue} 40% 36%)` : `hsl(${hue} 58% 80%)`;
}
