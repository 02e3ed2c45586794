import assert from "node:assert/strict";
import test from "node:test";

import { MISSING, jointRows, quantities, withSigma } from "../src/values.js";

const named = (connection, frame) => Object.fromEntries(quantities(connection, frame, "en").map(({ name, text, reason }) => [name, [text.replaceAll("\u00a0", " "), reason]]));

test("a value has its σ and unit", () => {
  assert.equal(withSigma([11.26, 0.31], 1, "kg", "de"), "11,3\u00a0±\u00a00,3\u00a0kg");
  assert.equal(withSigma([-0.3, 0], 0, "N", "en"), "0\u00a0N");
});

test("a valid value is displayed, a withheld one has its reason", () => {
  const state = { vertical_force_n: 706.4, delta_f_n: [0, 0, 88.6], delta_f_sigma_n: 3.5, lifts: 3, dose_damage: 0.00003512, dose_probability: 0.054 };
  const shown = named("live", { state, withheld: { lifted_mass: "moving", torques: "moving" } });
  assert.deepEqual(shown.vertical_force, ["706 N", ""]);
  assert.deepEqual(shown.external_force, ["89 ± 4 N", ""]);
  assert.deepEqual(shown.load, [MISSING, "moving"]);
  assert.deepEqual(shown.dose_damage, ["0.000035", ""]);
  assert.deepEqual(shown.dose_probability, ["5.4 %", ""]);
  const before = named("live", { state: { ...state, dose_damage: 0, dose_probability: 0 } });
  assert.deepEqual([before.dose_damage, before.dose_probability], Array(2).fill([MISSING, "not_available"]));
  assert.deepEqual(shown.mass, [MISSING, "not_available"]);
});

test("a flag that concerns one quantity is its reason", () => {
  assert.deepEqual(named("live", { state: { valid: ["mass_unknown"] } }).mass, [MISSING, "mass_unknown"]);
});

test("what the sensors do not measure is named", () => {
  const shown = named("live", { state: { unavailable: ["shear"], vertical_force_n: 1 } });
  assert.deepEqual(shown.shear, [MISSING, "not_measured"]);
});

test("no number without a frame, or that is none", () => {
  for (const [connection, reason] of [["silent", "silent"], ["lost", "lost"], ["waiting", "connecting"], ["ended", "ended"]]) {
    assert.ok(Object.values(named(connection, null)).every(([text, why]) => text === MISSING && why === reason), connection);
  }
  for (const none of [null, NaN, Infinity, "1"]) assert.deepEqual(named("live", { state: { mass_kg: none } }).mass, [MISSING, "not_available"]);
});

test("a joint without a torque has no share of its limit, but its fatigue", () => {
  const joint = { torque_nm: [3, 4, 0], sigma_nm: 1, level: "green", limit_nm: 50 };
  const [a, b, c] = jointRows(["L5S1", "LeftHip", "LeftKnee"], {
    state: { joints: { L5S1: joint, LeftKnee: { torque_nm: [0, 0, 1], level: "undecided" } }, fatigue: { LeftHip: 0.25 }, worst_joint: "L5S1" },
  });
  assert.deepEqual([a.torque, a.limitRatio, a.limitRatioSigma, a.isWorst], [5, 0.1, 0.02, true]);
  assert.deepEqual(b, { name: "LeftHip", level: "none", fatigue: 0.25 });
  assert.deepEqual([c.torque, c.limitRatio, c.isWorst], [1, undefined, false]);
});
