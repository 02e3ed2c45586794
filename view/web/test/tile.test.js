import assert from "node:assert/strict";
import test from "node:test";
import { attention, tile } from "../src/tile.js";

const STATE = { phase: "monitoring", valid: [], worst_joint: "L5S1", lifted_mass_kg: 8, lifted_mass_sigma_kg: 0.25,
  joint: { torque_nm: [0, 30, 40], sigma_nm: 2, level: "orange", limit_nm: 100 } };
const one = (more) => tile({ url: "http://press-1:8080/", connection: "live", station: "press-1", state: STATE, incidents: [], ...more }, "en");

test("a live station shows the joint closest to its limit, with σ, and the load", () => {
  const shown = one({});
  assert.equal(shown.torque, "50.0\u00a0±\u00a02.0\u00a0N\u00a0m, 50\u00a0%");
  assert.deepEqual([shown.name, shown.joint, shown.level, shown.load, attention(shown)], ["press-1", "joint.L5S1", "orange", "8.0\u00a0±\u00a00.3\u00a0kg", false]);
});

test("a withheld torque is its reason, the cause rather than its consequence", () => {
  const shown = one({ state: { phase: "degraded", valid: ["not_identified", "ground_stale"] } });
  assert.deepEqual([shown.joint, shown.torque, shown.level, shown.reason, shown.load], ["", "", "none", "reason.ground_stale", "—"]);
});

test("a fault is shown rather than its consequences, and needs attention", () => {
  const shown = one({ state: { phase: "degraded", valid: ["not_identified", "feet_off_plate", "plate_fault"] } });
  assert.deepEqual([shown.reason, attention(shown)], ["reason.plate_fault", true]);
  const off = one({ state: { phase: "monitoring", valid: ["feet_off_plate"] } });
  assert.deepEqual([off.reason, attention(off)], ["reason.feet_off_plate", false]);
});

test("a silent or lost station shows no value, and is known by its address", () => {
  for (const [connection, reason] of [["silent", "reason.silent_station"], ["lost", "reason.lost_station"]]) {
    const shown = one({ connection, station: null, state: null, incidents: null });
    assert.deepEqual([shown.name, shown.reason, shown.load, shown.known, attention(shown)], ["press-1:8080", reason, "—", false, true]);
  }
});

test("an active incident needs attention, an ended one does not", () => {
  assert.equal(attention(one({ incidents: [{ name: "suit_silent", active: true }] })), true);
  assert.equal(attention(one({ incidents: [{ name: "suit_silent", active: false }] })), false);
});

test("a station with other data or an invalid address is shown as lost", () => {
  for (const [more, name] of [[{ state: {} }, "press-1:8080"], [{ state: null }, "press-1:8080"], [{ incidents: {} }, "press-1:8080"], [{ connection: "lost", station: null, url: "http://press 1/" }, "http://press 1/"]]) {
    const shown = one({ ...more });
    assert.deepEqual([shown.name, shown.connection, shown.reason, attention(shown)], [name, "lost", "reason.lost_station", true]);
  }
});
