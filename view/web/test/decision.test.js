import assert from "node:assert/strict";
import test from "node:test";

import { Decider, HOLD_MS, viewOf } from "../src/decision.js";

const ORIGINS = [[0, 0, 1]];
const FAULT = { name: "suit_stale", fault: true };

// A frame as the server sends it: of a worker with an evaluated load, unless changed.
const frame = ({ state = {}, ...more } = {}) => ({
  phase_name: "monitoring", instruction: { key: "instruction.orange", tone: "warn", joint: "LeftKnee" }, reasons: [],
  worst: { joint: "LeftKnee", level: "orange" }, advice_name: "closer", segment_origin_m: ORIGINS,
  state: { phase: "monitoring", valid: [], fatigue: { LeftKnee: 0.2 }, lifted_mass_kg: 6, ...state }, ...more,
});
// A reason withholds the torques, so worst joint and load are absent.
const withheld = (name, more = {}) => frame({
  worst: undefined, reasons: [{ name, fault: false }], instruction: { key: `reason.${name}`, tone: "calm" },
  state: { valid: [name], lifted_mass_kg: undefined }, ...more,
});
const posed = (more = {}) => frame({
  worst: undefined, suggested: {}, phase_name: "identifying", instruction: { key: "instruction.take_pose", tone: "calm" },
  state: { phase: "identifying", valid: ["not_identified"], pose_mismatch_rad: 0.6 }, ...more,
});

test("each situation has its banner, card and figure", () => {
  const kinds = (view) => [view.kind, view.calibrating, view.posing, view.reasons.length > 0, view.level, view.figure.levels];
  assert.deepEqual(kinds(viewOf("live", frame())), ["load", false, false, false, "orange", true]);
  assert.deepEqual(kinds(viewOf("live", posed())), ["pose", true, true, false, null, false]);
  assert.deepEqual(kinds(viewOf("live", withheld("below_load_threshold"))), ["rest", false, false, false, null, false]);
  assert.deepEqual(kinds(viewOf("live", withheld("moving"))), ["withheld", false, false, true, null, false]);
  const silent = frame({ reasons: [FAULT], phase_name: "degraded", worst: undefined, state: { phase: "degraded", valid: ["suit_stale"] } });
  assert.deepEqual(kinds(viewOf("live", silent)), ["fault", false, false, true, null, false]);
  assert.deepEqual(kinds(viewOf("lost", null)), ["offline", false, false, true, null, false]);
});

test("the server's advice is given while torques are valid", () => {
  assert.deepEqual([viewOf("live", frame()).advice, viewOf("live", frame({ advice_name: undefined })).advice], ["closer", null]);
  assert.equal(viewOf("live", withheld("moving")).advice, null);
  assert.equal(viewOf("live", withheld("moving")).loadKg, null);
});

test("fatigue is not shown before a load has been evaluated", () => {
  assert.equal(viewOf("live", withheld("below_load_threshold", { state: { valid: ["below_load_threshold"], fatigue: { LeftKnee: 0 } } })).fatigue, null);
  assert.deepEqual(viewOf("live", frame()).fatigue, { LeftKnee: 0.2 });
});

test("during a fault its consequences are not listed", () => {
  const { reasons } = viewOf("live", frame({ reasons: [FAULT, { name: "moving", fault: false }] }));
  assert.deepEqual(reasons, [FAULT]);
});

test("a gap of less than a second keeps the words, but no value and no advice", () => {
  for (const [connection, gap] of [["live", withheld("moving")], ["silent", null], ["lost", null]]) {
    const decider = new Decider();
    const before = decider.decide(0, "live", frame());
    for (const now of [1, HOLD_MS - 1]) {
      const held = decider.decide(now, connection, gap);
      assert.deepEqual([held.banner, held.tone, held.kind], [before.banner, "warn", "load"]);
      assert.deepEqual([held.advice, held.loadKg, held.figure.levels, held.held], [null, null, false, true]);
      assert.equal(held.figure.faded, !gap, "a figure without data is faded");
    }
    assert.notDeepEqual(decider.decide(HOLD_MS, connection, gap).banner, before.banner);
    assert.equal(decider.decide(HOLD_MS + 1, "live", frame()).held, undefined, "data are shown at once");
  }
});

test("the end of a demonstration is shown at once, and is no fault", () => {
  const decider = new Decider();
  decider.decide(0, "live", frame());
  const ended = decider.decide(1, "ended", null);
  assert.deepEqual([ended.kind, ended.tone, ended.banner.key, ended.figure.frame], ["ended", "calm", "reason.ended", null]);
});

test("many short gaps do not add up", () => {
  const decider = new Decider();
  for (let now = 0; now < 10 * HOLD_MS; now += 500) {
    assert.equal(decider.decide(now, "live", frame()).kind, "load");
    assert.equal(decider.decide(now + 400, "lost", null).kind, "load");
  }
});

test("the server's alarm is shown at once: it was held for a second already", () => {
  const decider = new Decider();
  decider.decide(0, "live", frame());
  const raised = { worst: undefined, segment_origin_m: undefined, state: { valid: ["suit_stale"] } };
  assert.equal(decider.decide(10, "live", frame(raised)).kind, "load", "not yet in the headline");
  assert.equal(decider.decide(20, "live", frame({ ...raised, reasons: [FAULT] })).kind, "fault");
});

test("what is first seen is shown as it is", () => {
  assert.equal(new Decider().decide(0, "lost", null).kind, "offline");
  assert.equal(new Decider().decide(0, "live", withheld("moving")).kind, "withheld");
});
