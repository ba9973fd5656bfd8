// Colours of the theme, of joint groups and of clusters.
import { root, scene } from "./scene.js";

export const ink = { version: 0 };

export function readTheme() {
  const style = getComputedStyle(root);
  for (const name of ["paper", "text", "faint", "line", "accent", "panel", "obstacle", "character"]) {
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

export function clusterColour(cluster) {
  if (cluster < 0) return ink.line;
  const hue = (cluster * 137.508 + 200) % 360;
  return ink.dark ? `hsl(${hue} 45% 42%)` : `hsl(${hue} 62% 76%)`;
}
