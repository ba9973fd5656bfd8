// The views of the stage and their perspective projection.
import { clipFrame, scene, shownClips, size, state } from "./scene.js";

// The rectangle of each shown figure: left, top, width, height.
export function tiles() {
  const { width, height } = size;
  if (state.overlay) return [[0, 0, width, height]];
  const count = state.shown.length;
  let best = [1, 0];
  for (let columns = 1; columns <= count; columns++) {
    const room = Math.min(width / columns, (height / Math.ceil(count / columns)) * 0.8);
    if (room > best[1] * 1.001) best = [columns, room];
  }
  const columns = best[0];
  const lines = Math.ceil(count / columns);
  return state.shown.map((_, i) => [
    ((i % columns) * width) / columns,
    (Math.floor(i / columns) * height) / lines,
    width / columns,
    height / lines,
  ]);
}

export function camera(clip, frame, tile, pen) {
  const [left, top, width, height] = tile;
  const tall = scene.height;
  const sinYaw = Math.sin(state.yaw);
  const cosYaw = Math.cos(state.yaw);
  const sinPitch = Math.sin(state.pitch);
  const cosPitch = Math.cos(state.pitch);
  // A camera that does not follow stays where it was when following was switched off.
  const seen = state.follow ? frame : clipFrame(clip, state.stand);
  const k = Math.min(Math.round(seen / clip.step), clip.kept - 1) * 3;
  const target = [clip.cameraPath[k], scene.floor + 0.5 * tall, clip.cameraPath[k + 2]];
  const distance = ((state.follow ? 3.4 : 5) * tall) / state.zoom;
  // The figure fills two thirds of the height, and most of the width of a narrow view.
  const focus = 2.25 * Math.min(1.25 * width, height);
  const near = 0.05 * distance;
  const turn = (x, y, z) => {
    x -= target[0];
    y -= target[1];
    z -= target[2];
    const ahead = x * sinYaw + z * cosYaw;
    return [
      x * cosYaw - z * sinYaw + state.pan[0] * tall,
      y * cosPitch - ahead * sinPitch + state.pan[1] * tall,
      distance - (y * sinPitch + ahead * cosPitch),
    ];
  };
  const middle = [left + width / 2, top + height * 0.52];
  const flat = ([x, y, depth]) => {
    const scale = focus / Math.max(depth, near);
    return [middle[0] + x * scale, middle[1] - y * scale, scale];
  };
  // A line that ends behind the camera is clipped at the near plane.
  const line = (a, b) => {
    let p = turn(...a);
    let q = turn(...b);
    if (p[2] < near && q[2] < near) return;
    if (p[2] < near || q[2] < near) {
      const share = (near - p[2]) / (q[2] - p[2]);
      const cut = p.map((value, i) => value + share * (q[i] - value));
      if (p[2] < near) p = cut;
      else q = cut;
    }
    const [from, to] = [flat(p), flat(q)];
    pen.moveTo(from[0], from[1]);
    pen.lineTo(to[0], to[1]);
  };
  const isVisible = (x, y, z) => turn(x, y, z)[2] >= near;
  return { target, line, isVisible, point: (x, y, z) => flat(turn(x, y, z)), tall, tile };
}

// The view of each shown figure. In the overlay, all are seen by the camera of the first.
export function views(pen) {
  const places = tiles();
  const leader = shownClips()[0];
  return shownClips().map((clip, i) => {
    const seen = state.overlay ? leader : clip;
    return { clip, view: camera(seen, clipFrame(seen, state.frame), state.overlay ? places[0] : places[i], pen) };
  });
}
