// The body's tree and its colours. A test compares both lists with the body of the core.

// Parent of each segment, in MVN's order: pelvis, spine, head, right arm, left arm, right leg, left leg.
export const PARENT = [-1, 0, 1, 2, 3, 4, 5, 4, 7, 8, 9, 4, 11, 12, 13, 0, 15, 16, 17, 0, 19, 20, 21];

// Joint j is the origin of segment j + 1.
export const JOINT = [
  "L5S1", "L4L3", "L1T12", "T9T8", "T1C7", "C1Head",
  "RightT4Shoulder", "RightShoulder", "RightElbow", "RightWrist",
  "LeftT4Shoulder", "LeftShoulder", "LeftElbow", "LeftWrist",
  "RightHip", "RightKnee", "RightAnkle", "RightBallFoot",
  "LeftHip", "LeftKnee", "LeftAnkle", "LeftBallFoot",
];

export const HEAD = 6;
export const HANDS = [10, 14];
export const TOES = [18, 22];
export const FEET = [[17, 18], [21, 22]];

export const LEVEL_WORD = {
  none: "not judged", green: "low", orange: "medium", red: "high", above_max: "too high",
  undecided: "not sure",
};

// Size grows with the level, so that it can be told without colour.
export const LEVEL_RADIUS = { none: 0.020, green: 0.024, orange: 0.034, red: 0.042, above_max: 0.050, undecided: 0.030 };

export const add = (a, b, k = 1) => a.map((v, i) => v + k * b[i]);
export const sub = (a, b) => a.map((v, i) => v - b[i]);
export const norm = (a) => Math.hypot(...a);
export const magnitude = norm;

// Where a limb without a distal joint ends: along its parent's direction, `length` further.
export function tip(origins, segment, length) {
  const along = sub(origins[segment], origins[PARENT[segment]]);
  return add(origins[segment], along, length / Math.max(norm(along), 1e-6));
}

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// Fits a canvas to its box at the screen's own resolution and gives a cleared context in CSS pixels.
export function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { width, height } = canvas.getBoundingClientRect();
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) {
    canvas.width = w;
    canvas.height = h;
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}
