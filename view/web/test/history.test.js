import assert from "node:assert/strict";
import test from "node:test";

import { History } from "../src/history.js";

const state = (t, poses_used, motion_samples_used = 0) => ({ t, poses_used, motion_samples_used, nis: 2 });
const facts = (subject, cycle, names = ["Pelvis x"]) => ({ daemon: { subject }, parameters: { cycle, names } });

test("points have an interval, and a missing value is null", () => {
  const history = new History({ t: [1], variance_max_m2: [4], predicted_cop_sigma_m: [5], nis: [6], poses_used: [2], motion_samples_used: [0], parameters: [] });
  for (const t of [1.2, 1.6, 1.7, 2.2]) history.addState(state(t, 2));
  assert.deepEqual([history.t, history.variance_max_m2], [[1, 1.6, 2.2], [4, null, null]]);
});

test("one curve holds one identification", () => {
  for (const next of [state(0.5, 5, 9), state(2, 4, 9), state(2, 5, 8)]) {
    const history = new History();
    history.addFacts(facts("a", 3));
    history.addState(state(1, 5, 9));
    history.addState(next);
    assert.deepEqual([history.t, history.parameters], [[next.t], []]);
  }
});

test("one curve holds one worker", () => {
  const history = new History();
  history.addState(state(1, 5));
  history.addFacts(facts("a", 3));
  history.addFacts({ daemon: null, parameters: null });
  history.addFacts(facts("a", 4));
  assert.deepEqual([history.t.length, history.parameters.length], [1, 2]);
  history.addFacts(facts("b", 9));
  assert.deepEqual([history.t.length, history.parameters.map(({ cycle }) => cycle)], [0, [9]]);
});

test("another reduction or daemon begins a chart of parameters", () => {
  const history = new History();
  for (const [cycle, names] of [[5, ["Pelvis x"]], [9, ["Pelvis x"]], [9, ["Pelvis x"]]]) history.addFacts(facts("a", cycle, names));
  assert.equal(history.parameters.length, 2);
  history.addFacts(facts("a", 12, ["Pelvis y"]));
  assert.equal(history.parameters.length, 1);
  history.addFacts(facts("a", 3, ["Pelvis y"]));
  assert.equal(history.parameters.length, 1);
});
