// How well the worker's pose is the one asked for, limb by limb: by the directions of the bones, so that neither stature nor
// the place on the plate counts. The service's own `pose_mismatch_rad` decides; this only says where to look.
import { PARENT, sub } from "./body.js";

// Segments whose bone, from the parent's origin, belongs to a limb.
export const LIMBS = {
  back: [1, 2, 3, 4, 5], head: [6], right_arm: [8, 9, 10], left_arm: [12, 13, 14], right_leg: [16, 17], left_leg: [20, 21],
};
// The suit's own reading of the spine and of the feet differs from a drawn pose by some degrees.
export const LIMB_REACHED_RAD = 0.35;

function angle(a, b) {
  const dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const scale = Math.hypot(...a) * Math.hypot(...b);
  return scale > 1e-9 ? Math.acos(Math.min(1, Math.max(-1, dot / scale))) : 0;
}

// Largest angle between the worker's bones and the suggested ones for each limb, rad.
export function limbsOff(worker, suggested) {
  const bone = (origins, segment) => sub(origins[segment], origins[PARENT[segment]]);
  return Object.fromEntries(Object.entries(LIMBS).map(([limb, segments]) =>
    [limb, Math.max(...segments.map((segment) => angle(bone(worker, segment), bone(suggested, segment))))]));
}

// The limb that is farthest off, if any is.
export function worstLimb(off) {
  const [limb, rad] = Object.entries(off).reduce((worst, one) => (one[1] > worst[1] ? one : worst));
  return rad > LIMB_REACHED_RAD ? limb : null;
}

// 1 in the pose, 0 at a right angle from it; what the service calls reached is drawn as reached.
export function share(mismatchRad, reachedRad) {
  if (mismatchRad <= reachedRad) return 1;
  return Math.max(0, Math.min(0.95, 1 - (mismatchRad - reachedRad) / (Math.PI / 2)));
}

// Whether the limb that a segment belongs to is where it was asked for.
export function isPlaced(segment, off, reachedRad) {
  const limb = Object.keys(LIMBS).find((name) => LIMBS[name].includes(segment));
  return Boolean(limb && off && off[limb] <= reachedRad);
}
