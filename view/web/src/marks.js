// Marks on the figure: joints with their levels, load, centres of pressure, ground reaction, and where to move limbs.
import { HANDS, JOINT, add, isInStation, prepared, tip } from "./body.js";
import { LEVELS } from "./levels.js";
import { load } from "./numbers.js";
import { Pen } from "./pen.js";
import { colour } from "./theme.js";

// Radius of the ball of the highest level.
const JOINT_RADIUS_M = 0.062;
// As in the scene for Foxglove: 1 m per 1000 N.
const FORCE_M_PER_N = 0.001;
const COP_RADIUS_M = 0.05;
// A hand with more of the load than this carries it alone.
const ONE_HAND = 0.8;

// `shown`: the view of decision.js; `moves`: pairs of points between which limbs are to move.
export function drawMarks(canvas, view, shown, moves, language) {
  const { context } = prepared(canvas);
  const { frame, faded, levels } = shown.figure;
  const drawn = [];
  canvas.dataset.figurePx = view.figurePx.toFixed(0);
  if (frame && !faded) {
    const pen = new Pen(context, view.project);
    if (isInStation(frame)) drawn.push(...drawPressure(pen, frame.state, view.centre[2]));
    const label = shown.loadKg && drawLoad(pen, frame, shown.loadKg, view);
    if (levels) drawn.push(drawJoints(pen, frame));
    if (label) drawn.push(drawMass(pen, label, load(shown.loadKg, language)));
    for (const [from, to] of moves) {
      if (pen.arrow(from, to, colour("move"), colour("card"), 0.035 * view.project(from)[2])) drawn.push("move");
    }
  }
  // For tests of the page.
  canvas.dataset.drawn = [frame && "worker", frame?.suggested && "suggested", ...drawn].filter(Boolean).join(" ");
}

function drawPressure(pen, state, floor) {
  const { cop_measured: measured, cop_estimated: estimated, ground_force_n: force, vertical_force_n: vertical } = state;
  const drawn = [];
  const stroke = (points, style) => {
    pen.line(points, colour("card"), 0.034, 5);
    pen.line(points, style, 0.018, 3);
  };
  if (estimated) {
    const circle = Array.from({ length: 33 }, (_, i) => [estimated[0] + COP_RADIUS_M * Math.cos(i * Math.PI / 16), estimated[1] + COP_RADIUS_M * Math.sin(i * Math.PI / 16), floor]);
    stroke(circle, colour("estimated"));
    drawn.push("estimated");
  }
  if (measured) {
    const [x, y] = measured;
    for (const [a, b] of [[COP_RADIUS_M, 0], [0, COP_RADIUS_M]]) stroke([[x - a, y - b, floor], [x + a, y + b, floor]], colour("force"));
    drawn.push("measured");
    const newtons = force ?? (vertical === undefined ? null : [0, 0, vertical]);
    const from = [x, y, floor];
    if (newtons && pen.arrow(from, add(from, newtons, FORCE_M_PER_N), colour("force"), colour("card"), 0.022 * pen.project(from)[2])) drawn.push("force");
  }
  return drawn;
}

// Returns the middle of the lower edge, pixels.
function drawLoad(pen, frame, massKg, view) {
  const origins = frame.segment_origin_m;
  // The message has left before right, the segments right before left.
  const [left, right] = frame.state.hand_load_fraction ?? [0.5, 0.5];
  const [rightTip, leftTip] = HANDS.map((hand) => tip(origins, hand, 0.1));
  const centre = left > ONE_HAND ? leftTip : right > ONE_HAND ? rightTip : add(rightTip.map((v) => v / 2), leftTip, 0.5);
  const half = Math.min(0.16, 0.06 * Math.cbrt(massKg));
  const faces = [0, 1, 2].map((axis) => {
    const side = Math.sign(view.towards[axis]) || 1;
    return [[-1, -1], [-1, 1], [1, 1], [1, -1]].map((corner) => {
      const offset = [...corner];
      offset.splice(axis, 0, side);
      return add(centre, offset, half);
    });
  });
  for (const face of faces) pen.area(face, colour("load"), colour("card"), 0.92, 2);
  const [x, y, scale] = pen.project(centre);
  return [x, y + half * scale];
}

function drawMass(pen, [x, y], mass) {
  const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
  pen.text(mass, [x, y + 1.2 * rem], 1.7 * rem, colour("ink"), colour("card"));
  return "load";
}

function drawJoints(pen, frame) {
  // Painter's algorithm: far joints first.
  const order = JOINT.map((name, index) => ({ name, at: frame.segment_origin_m[index + 1] }))
    .sort((a, b) => pen.project(a.at)[2] - pen.project(b.at)[2]);
  for (const { name, at } of order) {
    const { colour: fill, ink, sign, size } = LEVELS[frame.state.joints?.[name]?.level] ?? LEVELS.none;
    const [x, y, scale] = pen.project(at);
    const radius = JOINT_RADIUS_M * size;
    if (name === frame.worst.joint) pen.disc(at, radius + 0.03, colour("card"), colour("ink"), 0.014 * scale);
    pen.disc(at, radius, fill, "#ffffff", 0.006 * scale);
    if (size > LEVELS.none.size) pen.text(sign, [x, y + 0.04 * radius * scale], 1.35 * radius * scale, ink);
  }
  return "joints";
}
