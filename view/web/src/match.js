// Deviation of the worker's pose from the suggested one per limb, from the directions of the bones: independent of stature and
// position. For display only; the daemon's `pose_mismatch_rad` decides.
import { PARENT, norm, sub } from "./body.js";

// Segments whose bone, from the parent's origin, is part of a limb.
export const LIMBS = {
  back: [1, 2, 3, 4, 5], head: [6], right_arm: [8, 9, 10], left_arm: [12, 13, 14], right_leg: [16, 17], left_leg: [20, 21],
};
// The suit's estimate of spine and feet deviates from a library pose by some degrees.
export const LIMB_REACHED_RAD = 0.35;

// Segment whose origin an arrow moves to that of the suggested pose: of a leg the pelvis, since the feet stay.
const LIMB_END = { back: 5, head: 6, right_arm: 10, left_arm: 14, right_leg: 0, left_leg: 0 };
const ARROW_MIN_M = 0.1;

function angle(a, b) {
  const dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const scale = Math.hypot(...a) * Math.hypot(...b);
  return scale > 1e-9 ? Math.acos(Math.min(1, Math.max(-1, dot / scale))) : 0;
}

// Largest angle between the worker's and the suggested bones of each limb, rad.
export function limbDeviations(worker, suggested) {
  const bone = (origins, segment) => sub(origins[segment], origins[PARENT[segment]]);
  return Object.fromEntries(Object.entries(LIMBS).map(([limb, segments]) =>
    [limb, Math.max(...segments.map((segment) => angle(bone(worker, segment), bone(suggested, segment))))]));
}

// Limb with the largest deviation, if it exceeds the threshold.
export function worstLimb(deviations) {
  const [limb, rad] = Object.entries(deviations).reduce((worst, one) => (one[1] > worst[1] ? one : worst));
  return rad > LIMB_REACHED_RAD ? limb : null;
}

// Agreement with the pose: 1 if the daemon's criterion is met, 0 at a right angle beyond it.
export function agreement(mismatchRad, reachedRad) {
  if (mismatchRad <= reachedRad) return 1;
  return Math.max(0, Math.min(0.95, 1 - (mismatchRad - reachedRad) / (Math.PI / 2)));
}

// Whether the limb of a segment matches the suggested pose.
export function isPlaced(segment, deviations, reachedRad) {
  const limb = Object.keys(LIMBS).find((name) => LIMBS[name].includes(segment));
  return Boolean(limb && deviations && deviations[limb] <= reachedRad);
}

// Movements that place the deviating limbs, as pairs of points.
export function movements(worker, suggested, deviations) {
  const isOff = (limb) => deviations[limb] > LIMB_REACHED_RAD;
  // The head moves with the back.
  const limbs = Object.keys(LIMB_END).filter((limb) => isOff(limb) && !(limb === "head" && isOff("back")));
  return [...new Set(limbs.map((limb) => LIMB_END[limb]))].map((segment) => [worker[segment], suggested[segment]])
    .filter(([from, to]) => norm(sub(to, from)) > ARROW_MIN_M);
}
