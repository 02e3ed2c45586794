import assert from "node:assert/strict";
import test from "node:test";

import { Hold } from "../src/hold.js";

const standing = () => Array.from({ length: 23 }, (_, i) => [0, 0, i / 10]);
const moved = (by) => standing().map(([x, y, z]) => [x + by, y, z]);

test("the ring fills while nothing moves, and is full only when the service says so", () => {
  const hold = new Hold();
  const seen = (now, still = false, origins = standing()) => hold.see(now, { origins, reached: true, still, poses: 0 }).share;
  assert.equal(seen(0), 0);
  assert.ok(seen(400) > 0.3 && seen(400) < 0.6);
  assert.ok(seen(60_000) < 1, "not by waiting");
  assert.equal(seen(60_010, true), 1);
});

test("who moves, or leaves the pose, begins again", () => {
  const hold = new Hold();
  const see = (now, origins, reached = true) => hold.see(now, { origins, reached, still: false, poses: 0 }).share;
  see(0, standing());
  assert.ok(see(500, moved(0.01)) > 0, "a body sways");
  assert.equal(see(600, moved(0.05)), 0);
  assert.equal(see(1200, moved(0.05), false), 0);
  assert.equal(see(1300, null), 0, "nothing is known of the worker");
});

test("a pose that was taken is told once", () => {
  const hold = new Hold();
  const see = (now, poses) => hold.see(now, { origins: standing(), reached: false, still: false, poses }).done;
  assert.equal(see(0, 3), false, "who comes late sees nothing done");
  assert.equal(see(100, 4), true);
  assert.equal(see(10_000, 4), false);
  assert.equal(see(10_100, 0), false, "forgotten poses are no success");
});
