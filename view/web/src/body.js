// The body's tree. A test compares both lists with the body of the core.

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
// Height of the ankle above the floor, and of the crown above the joint of the head.
const [ANKLE_M, HEAD_M] = [0.09, 0.2];
export const HANDS = [10, 14];
export const TOES = [18, 22];
export const FEET = [[17, 18], [21, 22]];

// Radius of each segment's bone from its parent's origin, m; those of the torso are trunk radii.
export const BONE_RADIUS = [
  0, 0.085, 0.085, 0.085, 0.085, 0.055, 0.04, 0.05, 0.05, 0.042, 0.034, 0.05, 0.05, 0.042, 0.034,
  0.075, 0.066, 0.05, 0.04, 0.075, 0.066, 0.05, 0.04,
];

// Whether the position of the body in the station is valid: otherwise plate and CoP are not drawn with it.
export const isInStation = (frame) => !frame.state.valid.includes("position_unknown");
// Corners of the plate next to the body.
export const cornersOf = (frame) => (frame && isInStation(frame) ? frame.plate_corners_m : undefined);

export const add = (a, b, k = 1) => a.map((v, i) => v + k * b[i]);
export const sub = (a, b) => a.map((v, i) => v - b[i]);
export const norm = (a) => Math.hypot(...a);

// End point of a segment without a distal joint: `length` further in the direction of its parent's bone.
export function tip(origins, segment, length) {
  const along = sub(origins[segment], origins[PARENT[segment]]);
  return add(origins[segment], along, length / Math.max(norm(along), 1e-6));
}

// All bones of a figure: end points and radius (m), and segment.
export function bones(origins) {
  const all = PARENT.map((parent, segment) => ({ from: origins[parent], to: origins[segment], radius: BONE_RADIUS[segment], segment })).slice(1);
  for (const hand of HANDS) all.push({ from: origins[hand], to: tip(origins, hand, 0.12), radius: 0.03, segment: hand });
  for (const toe of TOES) all.push({ from: origins[toe], to: tip(origins, toe, 0.05), radius: 0.035, segment: toe });
  return all;
}

// Radius of a cobot's stand, arm and part, and of a hand next to the part, m.
const [STAND_M, ARM_M, PART_M, HAND_M] = [0.09, 0.05, 0.08, 0.05];

// Bones of a simulated cobot: its stand, the arm, and the part across between the hands of a worker who faces X.
export function cobotBones({ arm_m: arm, part_width_m: width }) {
  const half = [0, Math.max(width / 2 - PART_M - HAND_M, 0.01), 0];
  const joints = [[arm[0][0], arm[0][1], 0], ...arm];
  const links = arm.map((to, i) => ({ from: joints[i], to, radius: i ? ARM_M : STAND_M, segment: "arm" }));
  return [...links, { from: add(arm.at(-1), half, -1), to: add(arm.at(-1), half), radius: PART_M, segment: "part" }];
}

export const headCentre = (origins) => tip(origins, HEAD, 0.09);

// Height of the worker when standing upright, m: the bones from floor to head, in any pose.
export function standingHeight(origins) {
  const chain = [1, 2, 3, 4, 5, HEAD, 20, 21];
  const bonesM = chain.reduce((sum, segment) => sum + norm(sub(origins[segment], origins[PARENT[segment]])), 0);
  return bonesM + ANKLE_M + HEAD_M;
}

// Resizes a canvas to its box at device resolution and returns a cleared context in CSS pixels.
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
