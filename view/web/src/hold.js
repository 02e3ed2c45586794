// Ring that counts down while the worker keeps a pose. The daemon detects a static pose (`static_pose`: 20 suit samples
// without motion); until then the ring shows the time since the last motion of a joint and does not reach its end.
import { norm, sub } from "./body.js";

const MOTION_M = 0.03;
const HOLD_S = 0.9;
const REMAINING_MIN_S = 0.1;
const DONE_SHOWN_MS = 1500;

export class Hold {
  constructor() {
    this.doneAt = -Infinity;
    this.poses = null;
  }

  // Seconds that remain at `now` (ms), the filled fraction of the ring in [0, 1], and whether a pose was just recorded.
  update(now, { origins, reached, isStatic, poses }) {
    if (this.poses !== null && poses === this.poses + 1) this.doneAt = now;
    this.poses = poses;
    const done = now - this.doneAt < DONE_SHOWN_MS;
    if (!origins || !reached) {
      this.reference = null;
      return { remainingS: HOLD_S, fraction: 0, done };
    }
    const moved = !this.reference || origins.some((origin, i) => norm(sub(origin, this.reference[i])) > MOTION_M);
    if (moved) [this.reference, this.since] = [origins, now];
    const remainingS = isStatic ? 0 : Math.max(REMAINING_MIN_S, HOLD_S - (now - this.since) / 1000);
    return { remainingS, fraction: 1 - remainingS / HOLD_S, done };
  }
}
