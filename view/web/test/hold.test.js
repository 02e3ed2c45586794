import assert from "node:assert/strict";
import test from "node:test";

import { Hold } from "../src/hold.js";

const standing = () => Array.from({ length: 23 }, (_, i) => [0, 0, i / 10]);
const moved = (by) => standing().map(([x, y, z]) => [x + by, y, z]);

test("the ring counts down during stillness and ends only with a static pose", () => {
  const hold = new Hold();
  const at = (now, isStatic = false, origins = standing()) => hold.update(now, { origins, reached: true, isStatic, poses: 0 });
  assert.deepEqual(at(0), { remainingS: 0.9, fraction: 0, done: false });
  assert.ok(Math.abs(at(400).remainingS - 0.5) < 1e-9);
  assert.equal(at(60_000).remainingS, 0.1, "not at its end by time alone");
  assert.deepEqual(at(60_010, true), { remainingS: 0, fraction: 1, done: false });
});

test("motion or another pose resets the ring", () => {
  const hold = new Hold();
  const fraction = (now, origins, reached = true) => hold.update(now, { origins, reached, isStatic: false, poses: 0 }).fraction;
  fraction(0, standing());
  assert.ok(fraction(500, moved(0.01)) > 0, "sway is no motion");
  assert.equal(fraction(600, moved(0.05)), 0);
  assert.equal(fraction(1200, moved(0.05), false), 0);
  assert.equal(fraction(1300, null), 0, "no data of the worker");
});

test("a recorded pose is reported once", () => {
  const hold = new Hold();
  const isDone = (now, poses) => hold.update(now, { origins: standing(), reached: false, isStatic: false, poses }).done;
  assert.equal(isDone(0, 3), false, "poses recorded before the page was opened");
  assert.equal(isDone(100, 4), true);
  assert.equal(isDone(10_000, 4), false);
  assert.equal(isDone(10_100, 0), false, "discarded poses");
});
