// What a tile of the page of several stations shows: texts by key, the level and the active incidents.
import { FAULTS } from "./decision.js";
import { MISSING, withSigma } from "./values.js";

// A lost or silent station shows the reason in place of a joint; a station with invalid data is shown as lost.
export function tile(station, language) {
  try {
    return shownOf(station, language);
  } catch {
    return shownOf({ url: String(station?.url), connection: "lost", error: station?.error }, language);
  }
}

// The host of an address; the address itself if the browser cannot parse it.
function hostOf(url) {
  try {
    return new URL(url).host;
  } catch {
    return url;
  }
}

function shownOf({ url, connection, station, state, incidents, error }, language) {
  const active = (incidents ?? []).filter((one) => one.active).map((one) => one.name);
  const joint = connection === "live" ? state.joint : null;
  const shown = {
    name: station ?? hostOf(url), url, connection, error: error ?? "", active, known: Boolean(incidents), fault: false,
    phase: connection === "live" ? `phase.${state.phase}` : "", level: "none", joint: "", torque: "", reason: "",
    load: connection === "live" && state.lifted_mass_kg > 0 ? withSigma([state.lifted_mass_kg, state.lifted_mass_sigma_kg], 1, "kg", language) : MISSING,
  };
  if (connection !== "live") {
    return { ...shown, reason: `reason.${connection === "waiting" ? "connecting" : connection === "silent" ? "silent_station" : "lost_station"}` };
  }
  // The other reasons are consequences of a fault.
  const fault = FAULTS.find((name) => state.valid.includes(name));
  if (!joint) return { ...shown, fault: Boolean(fault), reason: `reason.${fault ?? state.valid.find((name) => name !== "not_identified") ?? state.valid[0] ?? "connecting"}` };
  const torque = Math.hypot(...joint.torque_nm);
  const limitPercent = joint.limit_nm ? `, ${(100 * torque / joint.limit_nm).toFixed(0)}\u00a0%` : "";
  return { ...shown, level: joint.level, joint: `joint.${state.worst_joint}`, torque: `${withSigma([torque, joint.sigma_nm], 1, "N\u00a0m", language)}${limitPercent}` };
}

// Stations that need attention first: lost or silent, with a fault or with active incidents; the given order otherwise.
export function attention({ connection, active, fault }) {
  return connection === "lost" || connection === "silent" || fault || active.length > 0;
}
